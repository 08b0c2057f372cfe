"""The figures that have bounds: memory by minute, latency by quarter, accuracy, keyframes, the end."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_bench.runs.usage import peak_memory
from hsslam_bench.soak.long_run import EndTimes, LongRun
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.trajectory.ate import ate
from hsslam_node.geometry.trajectory import read_tum
from hsslam_services.run.run_info import RunInfo

_QUARTERS = 4
_WARM_SHARE = 1 / 6  # of the run in which memory may grow: 10 of 60 minutes


@dataclass(frozen=True)
class Memory:
    """Memory of all processes of a run, MB."""

    by_minute_mb: Sequence[float]  # after the first sixth
    spread: float  # largest relative difference of these from their median
    most_mb: float  # peak from the first pose to the last
    whole_mb: float  # peak with start and end


def memory_of(run: LongRun) -> Memory:
    """Memory figures of a run; the means are those of each minute after the first sixth of the run, but for
    an incomplete one at the end, in which the first processes may have ended."""
    times, sizes = np.array(run.memory_mb()).T if run.memory_mb() else np.zeros((2, 0))
    late = (times > run.minutes * _WARM_SHARE) & (times < max(np.floor(run.minutes), 1))
    if not late.any():
        return Memory((), math.inf, math.inf, math.inf)
    minutes = np.floor(times[late]).astype(int)
    means = [float(sizes[late][minutes == minute].mean()) for minute in np.unique(minutes)]
    middle = float(np.median(means))
    spread = float(np.abs(np.array(means) - middle).max()) / middle
    whole_mb = sum(peak_memory(run.usage).values()) / 1e6
    return Memory(means, spread, float(sizes.max()), whole_mb)


def p99_by_quarter_ms(run: LongRun) -> list[float]:
    """99th percentile of the latency in each quarter of the run, ms."""
    times, latencies = np.array(run.latencies_ms()).T
    edges = np.linspace(0, times[-1], _QUARTERS + 1)
    edges[-1] += 1e-9
    parts = [latencies[(times >= a) & (times < b)] for a, b in pairwise(edges)]
    return [float(np.percentile(part, 99)) if len(part) else float("inf") for part in parts]


def keyframes_after(run: LongRun, seconds: float) -> int:
    """Number of keyframes whose frames are more than `seconds` after the first frame."""
    begin_ns = run.poses[0].source_stamp_ns
    return sum(k.source_stamp_ns - begin_ns > seconds * 1e9 for k in run.keyframes)


def ate_of(folder: Path) -> float:
    """ATE RMSE of the trajectory of a run against the truth of its source, m; NaN with too few poses.

    Raises:
        RunFailedError: the source has no ground truth.
    """
    options = RunInfo.read(folder).options
    truth = open_ground_truth(options.source, options.source_options)
    if truth is None:
        raise RunFailedError(f"{folder.name}: source {options.source} has no true poses")
    return ate(read_tum(folder / "trajectory.txt"), truth.trajectory).rmse_m


def ended_in_time(end: EndTimes, everything_s: float) -> bool:
    """Whether trajectories were written in 2 s, the map in 10 s, and the run ended in `everything_s`."""
    return end.trajectories_s <= 2.0 and end.map_s <= 10.0 and end.everything_s <= everything_s


def end_in_words(end: EndTimes) -> str:
    """The times of an end in one line."""
    return (
        f"trajectories {end.trajectories_s:.1f} s, map {end.map_s:.1f} s, everything "
        f"{end.everything_s:.1f} s"
    )
