"""Faults of missing resources at the start of a process: file descriptors, threads, or its log file."""

import contextlib
import resource
import secrets
import socket
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import psutil

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.runs.live_run import SMALL_ROOM, LiveRun
from hsslam_services.bus.bus import free_endpoint

_LIMIT = 256
_MOST_HELD = 400
_WATCH_S = 20.0
_V2, _V1 = Path("/sys/fs/cgroup"), Path("/sys/fs/cgroup/pids")
_WITHOUT_THREADS = ("mesher", "global_ba")  # killed, and not to be started
_WITHOUT_S = 8.0
_FEWEST_POSES = 60  # of the 120 of these seconds


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
    _kill(run, "mesher")
    run.ends_within(_WATCH_S)
    stopped.set()
    holder.join()
    is_bad, ended = _ended(run)
    return Finding(is_bad, f"{descriptors} descriptors of {_LIMIT}; {ended}")


def no_thread_can_start(experiment: Experiment) -> Finding:
    """Allow no new thread, kill two processes and ask for a map; expect poses, results and no traceback."""
    maps = experiment.folder / "maps"
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000", "--maps", str(maps))
    run.wait_for_poses(20)
    run.wait_until(lambda: all(run.pid_of(name) for name in _WITHOUT_THREADS), 60)
    with _no_new_threads(run):
        _kill(run, *_WITHOUT_THREADS)
        seen, begin_s = len(run.new_poses()), time.monotonic()
        refused = run.control("save", "during", timeout_s=_WITHOUT_S)
        while run.code is None and time.monotonic() - begin_s < _WITHOUT_S:
            time.sleep(0.1)
        came = len(run.new_poses()) - seen if run.code is None else 0
    if run.code is None:
        run.control("save", "later")
    is_saved = (maps / "later.safetensors").exists()
    is_bad, ended = _ended(run, "mesh.ply")
    return Finding(
        came < _FEWEST_POSES or is_bad or not is_saved,
        f"{came} poses in {_WITHOUT_S:g} s without a new thread; save: {refused[:40]!r}, later saved: "
        f"{is_saved}; {ended}",
    )


def log_of_a_process_cannot_be_opened(experiment: Experiment) -> Finding:
    """A folder blocks the mesher's log, and the mesher dies; expect that the run continues and saves."""
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000")
    run.wait_for_poses(20)
    run.wait_until(lambda: run.pid_of("mesher"), 60)
    log = run.out / "logs" / "mesher.log"
    log.unlink()
    log.mkdir()
    _kill(run, "mesher")
    seen = len(run.new_poses())
    time.sleep(5.0)
    came = len(run.new_poses()) - seen if run.code is None else 0
    is_bad, ended = _ended(run, "mesh.ply")
    is_reported = "mesher cannot be started" in run.stderr
    return Finding(
        came < 30 or is_bad or not is_reported,
        f"{came} poses in the next 5 s; reported: {is_reported}; {ended}",
    )


def _kill(run: LiveRun, *names: str) -> None:
    """Kill these processes, as far as they run; do not wait for their successors."""
    for name in names:
        if (pid := run.pid_of(name)) is not None:
            psutil.Process(pid).kill()


def _ended(run: LiveRun, *also: str) -> tuple[bool, str]:
    """End the run; returns whether a traceback was printed, a result is missing or the exit code says so, and
    the end in words.

    `also`: files that it must write besides trajectory and map.
    """
    if run.code is None:
        run.signal()
    code = run.finish()
    lost = run.missing("trajectory.txt", "map.safetensors", *also)
    has_trace = "Traceback" in run.stderr
    words = f"exit code {code}; traceback: {has_trace}; not written: {lost or 'nothing'}"
    return has_trace or bool(lost) or code not in (0, 3), words


@contextlib.contextmanager
def _no_new_threads(run: LiveRun) -> Iterator[None]:
    """Put all processes of the run into a control group that allows no more of them."""
    root = _V2 if (_V2 / "cgroup.controllers").exists() else _V1
    group = root / f"hsslam-bench-{secrets.token_hex(4)}"
    limit = group / "pids.max"
    try:
        group.mkdir()
        limit.read_text()  # some systems have groups without it
        supervisor = psutil.Process(run.process.pid)
        _move([supervisor.pid, *(each.pid for each in supervisor.children(recursive=True))], group)
        limit.write_text("0")
    except (OSError, psutil.NoSuchProcess) as error:
        _remove(group, root)
        raise CouldNotTellError(f"{group}: {error}: expected control groups") from None
    try:
        yield
    finally:
        limit.write_text("max")
        _remove(group, root)


def _remove(group: Path, root: Path) -> None:
    """Remove a control group; its processes go back to the root."""
    with contextlib.suppress(OSError):  # there is none, or a process starts in it meanwhile
        _move(map(int, (group / "cgroup.procs").read_text().split()), root)
        group.rmdir()


def _move(pids: Iterable[int], group: Path) -> None:
    """Move processes to a control group; passes over those that no longer live."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            (group / "cgroup.procs").write_text(str(pid))


def _hold(port: int, stopped: threading.Event) -> None:
    held: list[socket.socket] = []
    while not stopped.wait(0.002):
        with contextlib.suppress(OSError):
            held.append(socket.create_connection(("127.0.0.1", port), timeout=0.5))
        if len(held) > _MOST_HELD:
            held.pop(0).close()
    for connection in held:
        connection.close()
