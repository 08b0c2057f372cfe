"""A process of the service's kind that behaves as the file `behaviour` of its run folder says."""

import atexit
import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hsslam_node.errors import OutOfMemoryError, UserError
from hsslam_proto.requests import QUERY
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.run.stop_signals import END_SIGNAL


class _Remnant:
    """An object that leaves a file when Python frees it."""

    def __init__(self, freed: Path) -> None:
        self._freed = freed

    def __del__(self) -> None:
        self._freed.touch()


def _run(worker: Worker) -> None:
    behaviour = (worker.run.path / "behaviour").read_text()
    worker.count("laps")
    worker.ready()
    if behaviour == "bad input":
        pool = ThreadPoolExecutor(1)  # whose thread ends with the loop
        pool.submit(int).result()
        raise UserError("field = 3: expected 4")
    if behaviour == "faulty":
        raise ValueError("text of a plugin\nin two lines")
    if behaviour == "no memory":
        raise OutOfMemoryError("array x: needs 8 bytes")
    if behaviour == "full GPU":
        raise RuntimeError("CUDA out of memory. Tried to allocate 20.00 MiB. GPU 0 has none")
    if behaviour == "full disk":
        os.dup2(os.open("/dev/full", os.O_WRONLY), 2)
        worker.event("warning", "a line that its log has no room for")
    if behaviour == "hanging disk":
        _reader, hanging = os.pipe()
        os.set_blocking(hanging, False)
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(hanging, bytes(2**16))
        os.set_blocking(hanging, True)  # nothing reads it: a write does not return
        os.dup2(hanging, 2)
        worker.event("warning", "a line that its log never takes")
    if behaviour == "deaf":
        signal.signal(END_SIGNAL, signal.SIG_IGN)
    if behaviour == "warm":
        from hsslam_node.warm_start import warm_start

        assert warm_start(worker.options.slam).is_inherited
    if behaviour == "slow to answer":
        worker.bus.answer(QUERY, lambda _: (worker.run.path / "asked").touch() or time.sleep(60))
    if behaviour == "exit 0":
        os._exit(0)
    if behaviour == "too large":
        group = Path((worker.run.path / "control_group").read_text())
        group.write_text(str(os.getpid()))
        _ = bytearray(1_000_000_000)
    (worker.run.path / "at_work").touch()
    if behaviour == "starved":
        _starve(seconds=3.0)
    if behaviour in ("deaf", "stuck"):
        time.sleep(60)
    if behaviour == "crash":
        os.abort()
    while not worker.should_stop():
        time.sleep(0.02)
    (worker.run.path / "ended").write_text("in order")
    if behaviour == "crash at its end":
        os.abort()
    if behaviour == "leaves something to its end":
        ended = worker.run.path / "thread_ended"
        threading.Thread(target=lambda: (time.sleep(0.3), ended.touch())).start()
        globals()["remnant"] = _Remnant(worker.run.path / "freed")
        atexit.register((worker.run.path / "atexit_called").touch)
        print("not flushed", end="")


def _starve(seconds: float) -> None:
    """Compute at the lowest priority on a core that other processes use; then as before."""
    cores = os.sched_getaffinity(0)
    core = min(cores)
    spin = f"import os, time; os.sched_setaffinity(0, [{core}]); end_s = time.monotonic() + {seconds}\n"
    others = [
        subprocess.Popen([sys.executable, "-c", spin + "while time.monotonic() < end_s: pass"])
        for _ in range(3)
    ]
    for thread in (int(task.name) for task in Path("/proc/self/task").iterdir()):
        os.sched_setaffinity(thread, [core])
        os.sched_setscheduler(thread, os.SCHED_IDLE, os.sched_param(0))
    while any(other.poll() is None for other in others):
        sum(range(1000))
    with contextlib.suppress(PermissionError):  # only root may
        for thread in (int(task.name) for task in Path("/proc/self/task").iterdir()):
            os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
            os.sched_setaffinity(thread, cores)


def main() -> None:
    run_worker("sample_worker", _run)


if __name__ == "__main__":
    main()
