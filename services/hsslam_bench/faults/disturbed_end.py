"""Faults at the end of a run: a result is not writable, signals and kills come during the end."""

import contextlib
import signal
import time

import psutil

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.runs.live_run import SMALL_ROOM

_NOT_SAVED = 4  # exit code
_TRAJECTORIES = ("trajectory.txt", "trajectory_online.txt")
_MAP, _MESH = "map.safetensors", "mesh.ply"
_LENGTH = ("--synth.length", "20000")
_HALF_ROOM = (
    *("--source", "synth:room", "--synth.width-px", "320", "--synth.height-px", "240"),
    "--no-evaluate",
)
_RUN_S, _GRACE_S = 60.0, 10.0  # of `docker stop`
_WATCHDOG_S = 15.0


def one_result_cannot_be_written(experiment: Experiment) -> Finding:
    """A folder blocks trajectory.txt; expect code 4, the other results, and the arena kept and named."""
    run = experiment.serve(*SMALL_ROOM, *_LENGTH)
    run.wait_for_poses(20)
    (run.out / "trajectory.txt").mkdir()
    run.signal()
    code = run.finish()
    lost = run.missing(_MAP, _MESH)
    is_kept = run.arena_dir.is_dir() and str(run.arena_dir) in run.stderr
    return Finding(
        code != _NOT_SAVED or bool(lost) or not is_kept,
        f"exit code {code}; not written besides: {lost or 'nothing'}; arena kept and named: {is_kept}",
    )


def killed_after_short_grace(experiment: Experiment) -> Finding:
    """SIGTERM after a minute, SIGKILL 10 s later; expect trajectories and map."""
    run = experiment.serve(*_HALF_ROOM, *_LENGTH)
    run.wait_for_poses(10)
    time.sleep(_RUN_S)
    run.signal(signal.SIGTERM)
    code = run.ends_within(_GRACE_S)
    if code is None:
        run.kill_supervisor()
    lost = run.missing(*_TRAJECTORIES, _MAP)  # before the watchdog saves results
    return Finding(
        bool(lost),
        f"ended within {_GRACE_S:g} s of the signal: {code is not None}; not written: {lost or 'nothing'}",
    )


def second_signal_at_the_end(experiment: Experiment) -> Finding:
    """A second Ctrl-C during the end; expect an end within 5 s, the trajectories, and code 0 or 1."""
    run = experiment.serve(*_HALF_ROOM, *_LENGTH)
    run.wait_for_poses(300)
    run.signal()
    time.sleep(1.0)
    begin_s = time.monotonic()
    run.signal()
    code = run.ends_within(60.0)
    took_s = time.monotonic() - begin_s
    lost = run.missing(*_TRAJECTORIES)
    return Finding(
        code not in (0, 1) or took_s > 5.0 or bool(lost) or bool(run.left_behind(2.0)),
        f"exit code {code}, {took_s:.1f} s after the second signal; not written: {lost or 'nothing'}",
    )


def supervisor_killed_at_the_end(experiment: Experiment) -> Finding:
    """SIGKILL of the supervisor 0.5 s after Ctrl-C; expect that the watchdog saves all results."""
    run = experiment.serve(*SMALL_ROOM, *_LENGTH)
    run.wait_for_poses(60)
    run.signal()
    time.sleep(0.5)
    run.kill_supervisor()
    names = (*_TRAJECTORIES, _MAP, _MESH)
    left = run.left_behind(4 * _WATCHDOG_S)
    lost = run.missing(*names)
    return Finding(
        bool(lost) or bool(left), f"not written: {lost or 'nothing'}; left: {left or 'nothing'}"
    )


def process_killed_at_the_end(experiment: Experiment) -> Finding:
    """SIGKILL of the mapper in its last iterations; expect a report, an orderly end, and all results."""
    run = experiment.serve(*SMALL_ROOM, *_LENGTH)
    run.wait_for_poses(60)
    mapper = run.pid_of("mapper")
    run.signal()
    time.sleep(0.5)
    is_killed = False
    with contextlib.suppress(psutil.Error, TypeError):
        psutil.Process(mapper).kill()
        is_killed = True
    code = run.finish(120)
    if not is_killed:
        raise CouldNotTellError("the mapper had ended before it could be killed")
    lost = run.missing(*_TRAJECTORIES, _MAP, _MESH)
    is_reported = "mapper was killed by SIGKILL" in run.stderr
    return Finding(
        code not in (0, 3) or bool(lost) or bool(run.left_behind(2.0)) or not is_reported,
        f"exit code {code}; reported: {is_reported}; not written: {lost or 'nothing'}",
    )
