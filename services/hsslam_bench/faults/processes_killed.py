"""The fault of processes killed in turn: after each kill a right pose must follow soon."""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import psutil

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.runs.live_run import QUICK, LiveRun
from hsslam_bench.runs.run_log import read_log
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.se3 import inverse
from hsslam_proto import topics
from hsslam_proto.messages import Pose
from hsslam_services.log.parts import parts
from hsslam_services.run.run_info import RunInfo

KILLED = (
    *("tracker", "mapper", "recorder", "global_ba", "mesher", "fork_server", "camera"),
    "watchdog",
)
HALF_ROOM = (
    *("--source", "synth:room", "--synth.width-px", "320", "--synth.height-px", "240"),
    *("--rate-hz", "15", *QUICK),
)
_FOUND_S, _FOUND_M = 4.0, 0.02
_KILLS, _EVERY_S = 12, 12.0
_LOGGED = 0.9  # of the poses: a killed recorder loses its last second


@dataclass
class KillTally:
    """The kills, and the poses after them."""

    killed: list[str] = field(default_factory=list)
    slow: list[str] = field(default_factory=list)  # killed, and no right pose within 4 s
    wrong: int = 0  # tracked poses with an error above 2 cm
    worst_m: float = 0.0
    longest_s: float = 0.0
    map_version: int = 0  # newest
    back: int = 0  # poses on an older map than a pose before them

    def note(self, map_version: int) -> None:
        """Note the map of a pose; 0: it was aligned without one, as at load levels 5 and 6."""
        self.back += 0 < map_version < self.map_version
        self.map_version = max(self.map_version, map_version)

    def failed(self) -> bool:
        """Whether a pose came too late, was wrong, or was on an older map."""
        return bool(self.slow) or self.wrong > 0 or self.back > 0


def one_after_another(experiment: Experiment) -> Finding:
    """Kill twelve processes, one every 12 s."""
    frames = 15 * round(_KILLS * _EVERY_S + 30)
    run = experiment.serve(*HALF_ROOM, "--to-and-fro", "10", "--frames", str(frames))
    tally = kill_in_turn(run, _KILLS, _EVERY_S)
    code = run.finish(240)
    left = run.left_behind(2.0)
    logged, counts = logged_poses(run), run.summary()["frames"]
    poses = counts["tracked"] + counts["lost"]
    return Finding(
        code != 0 or tally.failed() or logged < _LOGGED * poses or bool(left),
        f"{described(tally, code, left)}; {logged} of {poses} poses in the log",
    )


def logged_poses(run: LiveRun) -> int:
    """Poses that the public reader finds in the parts of the log; none of a part that is damaged."""
    return sum(read_log(part).counts.get(topics.POSE.name, 0) for part in parts(run.out))


def described(tally: KillTally, code: int | None, left: list[str]) -> str:
    """The tally in one line."""
    return (
        f"{len(tally.killed)} kills; right pose within {tally.longest_s:.1f} s, too late after "
        f"{tally.slow or 'none'}; {tally.wrong} poses more than 2 cm off, the worst "
        f"{100 * tally.worst_m:.1f} cm; {tally.back} on an older map; exit code {code}; "
        f"left: {left or 'nothing'}"
    )


def kill_in_turn(
    run: LiveRun, kills: int, every_s: float, say: Callable[[str], None] = lambda _: None
) -> KillTally:
    """Kill one process after the other, and compare every pose with the truth."""
    run.wait_for_poses(60)
    truth = _truth(run)
    tally, seen = KillTally(), len(run.poses)
    for name in itertools.islice(itertools.cycle(KILLED), kills):
        if run.code is not None:
            tally.slow.append(f"end with code {run.code}")
            break
        run.wait_until(lambda name=name: run.pid_of(name) is not None, 60)
        killed_ns, found_s, begin_s = time.time_ns(), None, time.monotonic()
        pid = run.pid_of(name)
        if pid is None:
            raise CouldNotTellError(f"{name} has just ended")
        psutil.Process(pid).kill()
        tally.killed.append(name)
        while time.monotonic() - begin_s < every_s and run.code is None:
            for pose in run.new_poses()[seen:]:
                seen += 1
                if pose.status != "tracked" or pose.index >= len(truth):
                    continue
                off_m = float(np.linalg.norm(np.subtract(pose.t, truth[pose.index])))
                tally.worst_m = max(tally.worst_m, off_m)
                tally.note(pose.map_version)
                tally.wrong += off_m > _FOUND_M
                if found_s is None and _is_after(pose, killed_ns) and off_m <= _FOUND_M:
                    found_s = time.monotonic() - begin_s
            time.sleep(0.05)
        tally.longest_s = max(tally.longest_s, found_s or every_s)
        if found_s is None or found_s > _FOUND_S:
            tally.slow.append(name)
        say(f"{len(tally.killed)} of {kills} kills")
    return tally


def _is_after(pose: Pose, killed_ns: int) -> bool:
    return pose.stamp_ns > killed_ns


def _truth(run: LiveRun) -> np.ndarray:
    """True camera centres of all frames in the frame of the first camera, [N, 3] m."""
    options = RunInfo.read(run.out).options
    truth = open_ground_truth(options.source, options.source_options)
    if truth is None:
        raise CouldNotTellError(f"{options.source} has no ground truth")
    return (inverse(truth.T_world_cam[0]) @ truth.T_world_cam)[:, :3, 3]
