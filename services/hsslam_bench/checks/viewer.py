"""Rows of a full service: recorder, mesher, BA, a viewer that reads or is frozen, a robot that takes all."""

import contextlib
from collections.abc import Callable, Sequence
from functools import partial

from hsslam_bench.checks import live_figures
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.robot_client import NAMESPACE, AttachedRobot, rates_hz
from hsslam_bench.runs.run_log import LoggedPose
from hsslam_bench.runs.sequences import Skipped
from hsslam_bench.runs.serve_run import ServeRun, finished
from hsslam_bench.runs.session import Session
from hsslam_bench.runs.viewers import FROZEN_S, FrozenViewer
from hsslam_proto import topics
from hsslam_services.bus.bus import free_endpoint

_VIEWER_SEQUENCES = ("kitchen", "room")
_TRACKED, _TRACKED_60 = 0.99, 0.95
_P99_MS = 66.0
_ITERATIONS_HZ = 20.0
_ATE_FACTOR = 1.3
_SMALL_MS = 0.05  # smaller times are not shown
_FROZEN_SEQUENCES = ("kitchen", "room")
_SEQUENCE_OPTIONS = ("--pace", "realtime", "--rate-hz", "30")
_GRID_HZ, _GRID_SHARE = 10.0, 0.95  # of the rate, as the last grid of a run may be missing


def viewer_checks() -> list[Check]:
    """One check for each sequence and property, at 30 Hz and at 60 Hz."""
    thirty = [check for sequence in _VIEWER_SEQUENCES for check in _at_30_hz(sequence)]
    what = "30 Hz, a viewer attached: core time of the processes, ms a frame (of 66.7 on two cores)"
    budget = Check("budget", what, "", _budget)
    return [*thirty, *(_at_60_hz(sequence) for sequence in _VIEWER_SEQUENCES), budget]


def _at_30_hz(sequence: str) -> list[Check]:
    def run(session: Session) -> ServeRun:
        return finished(session.viewer(sequence))

    def iterations(session: Session) -> Measured:
        return live_figures.iterations(run(session), _ITERATIONS_HZ)

    name, of = f"viewer:{sequence}", f"{sequence}, 30 Hz, a viewer attached"
    rate = f"{_ITERATIONS_HZ:g} a second"
    return [
        *_in_time(name, of, sequence, run),
        Check(f"{name}:iterations", f"{of}: light mapping iterations", rate, iterations),
    ]


def _in_time(name: str, of: str, sequence: str, run: Callable[[Session], ServeRun]) -> list[Check]:
    """The checks of a run that keeps up: frames, latency, accuracy."""

    def tracked(session: Session) -> Measured:
        return live_figures.tracked(run(session), _TRACKED)

    def latency(session: Session) -> Measured:
        return live_figures.latency(run(session), "p99", _P99_MS)

    def accuracy(session: Session) -> Measured:
        lockstep = finished(session.lockstep(sequence))
        return live_figures.accuracy(run(session), lockstep, _ATE_FACTOR)

    limit, factor = f"p99 {_P99_MS:g} ms", f"{_ATE_FACTOR:g} x lockstep"
    return [
        Check(f"{name}:tracked", f"{of}: frames tracked after the first", "99%", tracked),
        Check(f"{name}:latency", f"{of}: latency to published pose", limit, latency),
        Check(f"{name}:ate", f"{of}: ATE RMSE, seed 0", factor, accuracy),
    ]


def _at_60_hz(sequence: str) -> Check:
    def tracked(session: Session) -> Measured:
        return live_figures.tracked(finished(session.sixty(sequence)), _TRACKED_60)

    what = f"{sequence}, 60 Hz, 320x240, a viewer attached: frames tracked after the first"
    return Check(f"sixty:{sequence}:tracked", what, f"{_TRACKED_60:.0%}", tracked)


def _budget(session: Session) -> Measured:
    runs = []
    for sequence in _VIEWER_SEQUENCES:
        with contextlib.suppress(Skipped):
            runs.append(finished(session.viewer(sequence)))
    texts = []
    for run in runs:
        shown = {process: ms for process, ms in run.core_ms.items() if ms >= _SMALL_MS}
        each = ", ".join(f"{process} {ms:.1f}" for process, ms in shown.items())
        texts.append(f"{run.name}: {sum(run.core_ms.values()):.1f} ({each})")
    return Measured("; ".join(texts), None, {run.name: run.core_ms for run in runs})


def robot_checks() -> list[Check]:
    """Checks of a run with grid, distances and output to ROS 2, all of them taken, beside a viewer."""
    return [check for sequence in _VIEWER_SEQUENCES for check in _with_robot(sequence)]


def _with_robot(sequence: str) -> list[Check]:
    def run(session: Session) -> ServeRun:
        return _robot_run(session, sequence)

    def rates(session: Session) -> Measured:
        log, arrivals_ns = run(session).log, run(session).outside["arrivals_ns"]
        if log.tracking_ns is None:
            return Measured("no pose after the first", False)
        found = rates_hz(arrivals_ns, *log.tracking_ns)
        slowest = min(found[topic.name] for topic in (topics.GRID, topics.ESDF, topics.ESDF_BLOCKS))
        text = ", ".join(f"{name} {hz:.1f}" for name, hz in found.items())
        is_ok = slowest >= _GRID_SHARE * _GRID_HZ and min(found.values()) > 0
        return Measured(f"{text} a second", is_ok, found, slowest, "higher")

    name, of = f"robot:{sequence}", f"{sequence}, 30 Hz, --grid and --ros2-out taken, a viewer"
    rate = f"grid and distances {_GRID_HZ:g} Hz"
    return [
        *_in_time(name, of, sequence, run),
        Check(f"{name}:rates", f"{of}: messages that arrive", rate, rates),
    ]


def _robot_run(session: Session, sequence: str) -> ServeRun:
    router = free_endpoint()
    outputs = ("--grid", "--ros2-out", NAMESPACE, "--ros2.connect", router)
    robot = partial(AttachedRobot, ros_router=router)
    options = (*_SEQUENCE_OPTIONS, *outputs)
    return finished(session.outside(f"robot-{sequence}", sequence, robot, *options, viewer="web"))


def frozen_checks() -> list[Check]:
    """One check for each sequence."""
    return [_check(sequence) for sequence in _FROZEN_SEQUENCES]


def _check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        run = finished(
            session.outside(
                f"frozen-{sequence}", sequence, FrozenViewer, *_SEQUENCE_OPTIONS, viewer="web"
            )
        )
        window = run.outside.get("frozen_ns", [])
        if len(window) < 2:
            return Measured("the viewer was not frozen: it received too little data", False)
        found = tracked_within(run.log.poses, window[0], window[1])
        if found is None:
            return Measured("no pose before or after the viewer was frozen", False)
        tracked, frames = found
        last = max(pose.index for pose in run.log.poses)
        elsewhere = last + 1 - len(_tracked(run.log.poses)) - (frames - tracked)
        seconds = (window[1] - window[0]) / 1e9
        return Measured(
            f"{tracked} of {frames} frames in {seconds:.1f} s; {elsewhere} dropped or lost in the rest of "
            f"{last + 1}",
            tracked == frames,
            {"tracked": tracked, "frames": frames, "elsewhere": elsewhere, "seconds": seconds},
            float(frames - tracked),
            "lower",
        )

    what = f"{sequence}, 30 Hz, viewer and its server frozen for {FROZEN_S:g} s: frames tracked meanwhile"
    return Check(f"frozen:{sequence}", what, "none dropped or lost", measure)


def tracked_within(
    poses: Sequence[LoggedPose], begin_ns: int, end_ns: int
) -> tuple[int, int] | None:
    """Number of tracked and of all frames from the last pose before `begin_ns` to the first after `end_ns`.

    So a stall counts up to its end. None: no pose before, or none after.
    """
    before = [pose.index for pose in poses if pose.publish_ns < begin_ns]
    after = [pose.index for pose in poses if pose.publish_ns >= end_ns]
    if not before or not after:
        return None
    frames = range(max(before) + 1, min(after))
    return len(_tracked(poses).intersection(frames)), len(frames)


def _tracked(poses: Sequence[LoggedPose]) -> set[int]:
    return {pose.index for pose in poses if pose.status != "lost"}
