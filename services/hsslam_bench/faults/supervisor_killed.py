"""Faults of a killed supervisor, as if memory ran out: results are saved, and a restart works."""

import json
import time

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import Finding
from hsslam_bench.runs.live_run import SMALL_ROOM
from hsslam_bench.runs.serve_run import RunFailedError

_LENGTH = ("--synth.length", "3000")
_SAVED = ("trajectory.txt", "trajectory_online.txt", "map.safetensors", "mesh.ply")
_WATCHDOG_S = 60.0
_STARTS = 20
_STEADY_S = 12.0


def results_are_saved(experiment: Experiment) -> Finding:
    """Kill the supervisor; expect that the watchdog saves all results and leaves nothing behind."""
    run = experiment.serve(*SMALL_ROOM, *_LENGTH)
    run.wait_for_poses(60)
    run.kill_supervisor()
    left = run.left_behind(_WATCHDOG_S)
    lost = run.missing(*_SAVED)
    return Finding(
        bool(lost) or bool(left), f"not written: {lost or 'nothing'}; left: {left or 'nothing'}"
    )


def same_folder_at_once(experiment: Experiment) -> Finding:
    """Kill the supervisor, start a run with the same --out at once; expect poses, and that both logs stay."""
    out = experiment.folder / "same"
    first = experiment.serve(*SMALL_ROOM, *_LENGTH, out=out)
    first.wait_for_poses(60)
    started_ns = _started_ns(out)
    first.kill_supervisor()
    for _ in range(_STARTS):  # as a service manager does
        second = experiment.serve(*SMALL_ROOM, *_LENGTH, out=out)
        try:
            second.wait_for_poses(30)
            break
        except RunFailedError:
            if "Traceback" in second.stderr:
                raise
            time.sleep(1.0)
    else:
        return Finding(True, f"does not start again in its folder: {second.last_words}")
    time.sleep(_STEADY_S)
    status = second.status()
    restarts = dict(status.restarts) if status else {"no answer": 1}
    has_watchdog = second.pid_of("watchdog") is not None
    is_restarted = _started_ns(out) != started_ns
    logs = sorted(path.name for path in experiment.folder.rglob("run*.mcap*"))
    second.signal()
    code = second.finish()
    hit = {name: count for name, count in restarts.items() if count}
    return Finding(
        bool(hit) or not has_watchdog or code != 0 or not is_restarted or len(logs) < 2,
        f"restarts of the second run: {hit or 'none'}; its watchdog lives: {has_watchdog}; exit code "
        f"{code}; logs: {logs}",
    )


def _started_ns(out) -> int:
    return json.loads((out / "run.json").read_text())["started_ns"]
