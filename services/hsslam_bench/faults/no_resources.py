"""Faults of missing resources at the start of a process: file descriptors, or its log file."""

import contextlib
import resource
import socket
import threading
import time
from pathlib import Path

import psutil

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.runs.live_run import SMALL_ROOM
from hsslam_services.bus.bus import free_endpoint

_LIMIT = 256
_MOST_HELD = 400
_WATCH_S = 20.0


def idle_connections_to_metrics(experiment: Experiment) -> Finding:
    """Hold 400 idle connections to /metrics, kill the mesher; expect results and no traceback."""
    if resource.getrlimit(resource.RLIMIT_NOFILE)[0] < 2 * _MOST_HELD:
        raise CouldNotTellError(f"ulimit -n: expected {2 * _MOST_HELD} or more")
    metrics = int(free_endpoint().rpartition(":")[2])
    run = experiment.serve(
        *SMALL_ROOM,
        *("--synth.length", "3000", "--metrics-port", str(metrics)),
        prefix=("prlimit", f"--nofile={_LIMIT}"),
    )
    run.wait_for_poses(20)
    run.wait_until(lambda: run.pid_of("mesher"), 60)
    run.close_bus()
    stopped = threading.Event()
    holder = threading.Thread(target=_hold, args=(metrics, stopped), daemon=True)
    holder.start()
    time.sleep(4.0)
    descriptors = sum(1 for _ in Path(f"/proc/{run.process.pid}/fd").iterdir())
    if (mesher := run.pid_of("mesher")) is not None:
        psutil.Process(mesher).kill()
    code = run.ends_within(_WATCH_S)
    stopped.set()
    holder.join()
    if code is None:
        run.signal()
        code = run.finish()
    lost = run.missing("trajectory.txt", "map.safetensors")
    has_trace = "Traceback" in run.stderr
    return Finding(
        has_trace or bool(lost),
        f"{descriptors} descriptors of {_LIMIT}; exit code {code}; traceback: {has_trace}; not "
        f"written: {lost or 'nothing'}",
    )


def log_of_a_process_cannot_be_opened(experiment: Experiment) -> Finding:
    """A folder blocks the mesher's log, and the mesher dies; expect that the run continues and saves."""
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000")
    run.wait_for_poses(20)
    run.wait_until(lambda: run.pid_of("mesher"), 60)
    log = run.out / "logs" / "mesher.log"
    log.unlink()
    log.mkdir()
    if (mesher := run.pid_of("mesher")) is not None:
        psutil.Process(mesher).kill()
    seen = len(run.new_poses())
    time.sleep(5.0)
    came = len(run.new_poses()) - seen if run.code is None else 0
    if run.code is None:
        run.signal()
    code = run.finish()
    lost = run.missing("trajectory.txt", "map.safetensors", "mesh.ply")
    has_trace = "Traceback" in run.stderr
    return Finding(
        came < 30 or bool(lost) or has_trace,
        f"{came} poses in the next 5 s; exit code {code}; traceback: {has_trace}; not written: "
        f"{lost or 'nothing'}",
    )


def _hold(port: int, stopped: threading.Event) -> None:
    held: list[socket.socket] = []
    while not stopped.wait(0.002):
        with contextlib.suppress(OSError):
            held.append(socket.create_connection(("127.0.0.1", port), timeout=0.5))
        if len(held) > _MOST_HELD:
            held.pop(0).close()
    for connection in held:
        connection.close()
