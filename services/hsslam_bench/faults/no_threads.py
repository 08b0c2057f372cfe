"""The fault of a full process table: for some seconds nothing in the run can start a thread or a process."""

import contextlib
import secrets
import time
from collections.abc import Iterator
from pathlib import Path

import psutil

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.runs.live_run import SMALL_ROOM, LiveRun

_V2, _V1 = Path("/sys/fs/cgroup"), Path("/sys/fs/cgroup/pids")
_KILLED = ("mesher", "global_ba")
_WITHOUT_S = 8.0
_FEWEST_POSES = 60  # of the 120 of these seconds


def no_thread_can_start(experiment: Experiment) -> Finding:
    """Allow no new thread, kill two processes and ask for a map; expect poses, results and no traceback."""
    maps = experiment.folder / "maps"
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000", "--maps", str(maps))
    run.wait_for_poses(20)
    run.wait_until(lambda: all(run.pid_of(name) for name in _KILLED), 60)
    with _no_new_threads(run):
        for name in _KILLED:
            if (pid := run.pid_of(name)) is not None:
                psutil.Process(pid).kill()
        seen, begin_s = len(run.new_poses()), time.monotonic()
        refused = run.control("save", "during", timeout_s=_WITHOUT_S)
        while run.code is None and time.monotonic() - begin_s < _WITHOUT_S:
            time.sleep(0.1)
        came = len(run.new_poses()) - seen if run.code is None else 0
    if run.code is None:
        run.control("save", "later")
    is_saved = (maps / "later.safetensors").exists()
    if run.code is None:
        run.signal()
    code = run.finish()
    lost = run.missing("trajectory.txt", "map.safetensors", "mesh.ply")
    has_trace = "Traceback" in run.stderr
    return Finding(
        came < _FEWEST_POSES or bool(lost) or has_trace or not is_saved,
        f"{came} poses in {_WITHOUT_S:g} s without a new thread; save: {refused[:40]!r}, later saved: "
        f"{is_saved}; exit code {code}; traceback: {has_trace}; not written: {lost or 'nothing'}",
    )


@contextlib.contextmanager
def _no_new_threads(run: LiveRun) -> Iterator[None]:
    """Put all processes of the run into a control group that allows no more of them."""
    root = _V2 if (_V2 / "cgroup.controllers").exists() else _V1
    group = root / f"hsslam-bench-{secrets.token_hex(4)}"
    try:
        group.mkdir()
        supervisor = psutil.Process(run.process.pid)
        for process in (supervisor, *supervisor.children(recursive=True)):
            (group / "cgroup.procs").write_text(str(process.pid))
        (group / "pids.max").write_text("0")
    except OSError as error:
        raise CouldNotTellError(f"{group}: {error.strerror}: expected control groups") from None
    try:
        yield
    finally:
        (group / "pids.max").write_text("max")
        with contextlib.suppress(OSError):  # a process ends while it is moved
            for pid in (group / "cgroup.procs").read_text().split():
                (root / "cgroup.procs").write_text(pid)
            group.rmdir()
