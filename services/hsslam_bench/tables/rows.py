"""Rows for preset `paper`: its speed and, measured only by name, whole sequences and rows of the ablation.

Apart from `checks`, which `results` imports.
"""

import math
import os
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.sequences import QUICK_FRAMES
from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_bench.runs.session import NotMeasured, Session
from hsslam_bench.tables.options import TableOptions
from hsslam_bench.tables.paper_tables import ABLATION, IMAGES, MESH
from hsslam_bench.tables.plan import Job, RunResult, plan_table
from hsslam_bench.tables.run_job import run_job
from hsslam_services.run.summary import names_code, source_commit

_BOUNDS_CM: Mapping[str, float | None] = {
    "house": 0.5,
    "house-kinect": 0.8,
    "livingroom": 0.6,
    "kitchen": None,
}
_ABLATION = ("full", "A", "E", "G", "H", "I")
_ABLATION_SEQUENCE = "house-kinect"
_SPEED_SEQUENCE, _SPEED_FRAMES, _SPEED_FPS = "house", 40, 1.0
_FOUND = "found.json"  # in the folder of a run
_QUICK = ("mapper.first_iterations=3", "mapper.rays=400", "mesher.final_voxel_m=0.1")
_UNITS = {"psnr_db": " dB", "ssim": ""}  # others have the unit in the name
_NAMES = {
    "accuracy_cm": "mesh {}",
    "completion_cm": "complete to {}",
    "completion_pct": "{} within 5 cm",
    "accuracy_lit_cm": "by the literature's protocol {}",
    "completion_lit_cm": "{}",
    "completion_lit_pct": "{}",
    "depth_l1_cm": "depth L1 {}",
    "psnr_db": "PSNR {}",
    "ssim": "SSIM {}",
}


def paper_checks() -> list[Check]:
    """One check for the speed, one for each whole sequence, one for each row of the ablation."""
    speed = f"{_SPEED_SEQUENCE}, first {_SPEED_FRAMES} frames, all cores: preset paper, speed"
    return [
        Check("paper:speed", f"{speed} and accuracy", f"{_SPEED_FPS:g} frame a second", _speed),
        *(_whole(sequence, bound_cm) for sequence, bound_cm in _BOUNDS_CM.items()),
        *(_ablated(row.name, row.title) for row in ABLATION.rows if row.name in _ABLATION),
    ]


def _speed(session: Session) -> Measured:
    cores = str(len(os.sched_getaffinity(0)))
    arguments = ("--threads", cores, "paper", session.source(_SPEED_SEQUENCE), str(_SPEED_FRAMES))
    found = session.figures("hsslam_bench.scripts.preset_speed", *arguments)
    return Measured(
        f"{found['fps']:.2f} frames a second, ATE RMSE {100 * found['rmse_m']:.2f} cm, "
        f"lost {found['lost']}",
        found["fps"] >= _SPEED_FPS and found["lost"] == 0,
        found,
        found["fps"],
        "higher",
    )


def _whole(sequence: str, bound_cm: float | None) -> Check:
    def measure(session: Session) -> Measured:
        found = [_result(session, "full", sequence, seed) for seed in session.seeds]
        return _measured(found, bound_cm)

    what = (
        f"{sequence}, every frame, preset paper: ATE RMSE, final; mesh by both protocols; PSNR and SSIM of "
        "frames held out; mean of the seeds, none lost"
    )
    bound = "" if bound_cm is None else f"{bound_cm:g} cm"
    return Check(f"paper:{sequence}", what, bound, measure, by_name_only=True)


def _ablated(row: str, title: str) -> Check:
    def measure(session: Session) -> Measured:
        found = [_result(session, row, _ABLATION_SEQUENCE, seed) for seed in session.seeds]
        return _measured(found, None)

    what = f"{_ABLATION_SEQUENCE}, every frame, preset paper, ablation ({row}) {title}: as above"
    return Check(f"paper:ablation:{row}", what, "", measure, by_name_only=True)


def _measured(found: Sequence[RunResult], bound_cm: float | None) -> Measured:
    ates = [result.values.get("ate_cm") for result in found]
    errors_cm = [math.inf if error is None else error for error in ates]
    ate_cm = statistics.fmean(errors_cm)
    lost = sum(int(result.values.get("lost") or 0) for result in found)
    each = ", ".join(f"{error:.3f}" for error in errors_cm)
    texts = [f"{ate_cm:.3f} cm (seeds: {each}), {lost} lost"]
    for metric in (*MESH, *IMAGES):
        values = [value for r in found if (value := r.values.get(metric)) is not None]
        if len(values) == len(found):
            texts.append(_NAMES[metric].format(_spread(values, metric)))
    texts.append(f"{statistics.fmean(r.values['fps'] or 0.0 for r in found):.2f} frames/s")
    return Measured(
        "; ".join(texts),
        None if bound_cm is None else ate_cm <= bound_cm and lost == 0,
        {f"seed {result.seed}": result.values for result in found},
        ate_cm,
        "lower",
    )


def _spread(values: Sequence[float], metric: str) -> str:
    """Mean and standard deviation over the seeds, with unit."""
    unit = _UNITS.get(metric, " %" if metric.endswith("_pct") else " cm")
    digits = 3 if metric == "ssim" else 2
    deviation = f" ± {statistics.stdev(values):.{digits}f}" if len(values) > 1 else ""
    return f"{statistics.fmean(values):.{digits}f}{deviation}{unit}"


def _result(session: Session, row: str, sequence: str, seed: int) -> RunResult:
    """The result of one run; a benchmark with the same --out keeps it.

    Raises:
        RunFailedError: the run failed; the text has its last line of output.
    """
    job = _job(session, row, sequence, seed)
    folder = session.folder / f"paper-{sequence}-{job.name}"
    result = _kept(folder, job, source_commit())
    if result is None:
        session.warm_up()
        result = run_job(
            job, folder, source_commit(),
            lambda done, total: session.say(f"{sequence} {job.name}: frame {done} of {total}"),
        )  # fmt: skip
        (folder / _FOUND).write_bytes(msgspec.json.encode(result))
    if result.error:
        raise RunFailedError(f"paper {sequence} {job.name}: {result.error}")
    return result


def _kept(folder: Path, job: Job, commit: str) -> RunResult | None:
    """The result of this or an earlier call for the job at this commit; None without one."""
    try:
        result = msgspec.json.decode((folder / _FOUND).read_bytes(), type=RunResult)
    except (OSError, msgspec.MsgspecError):
        return None
    is_same = (result.key, result.commit) == (job.key, commit) and not result.error
    return result if is_same and names_code(commit) else None


def _job(session: Session, row: str, sequence: str, seed: int) -> Job:
    place, _, noise = sequence.partition("-")
    session.source(place)  # raises Skipped if it is not on disk
    if session.extra:
        raise NotMeasured("options after -- are of hsslam-serve, which these rows do not run")
    options = TableOptions(
        data=session.data,
        preset="paper",
        seeds=(seed,),
        rows=(row,),
        sequences=(place,),
        frames=QUICK_FRAMES // 10 if session.quick else None,
        noise="kinect" if noise else "none",
        set=_QUICK if session.quick else (),
    )
    (job,) = plan_table(ABLATION, options).jobs
    return job
