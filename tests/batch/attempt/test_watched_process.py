"""A command that is watched ends within its limits, and no process of it is left, however it ended."""

import os
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

_SCRIPT = Path(__file__).with_name("watch_script.py")
# a process that outlives its parent in a session of its own and ignores to be asked to end
_STUBBORN = "trap '' TERM; echo $$ > pid.{0}; while :; do sleep 1; done"
_FAMILY = (
    f'setsid sh -c "{_STUBBORN.format("orphan").replace("$$", chr(92) + "$" + chr(92) + "$")}" & '
    f"while [ ! -s pid.orphan ]; do sleep 0.05; done; {{0}}"
)


def _watch(folder: Path, *command: str, timeout_s: float = 0.0, memory_gb: float = 0.0):
    limits = [str(folder / "output.txt"), str(timeout_s), str(memory_gb)]
    return subprocess.Popen(
        [sys.executable, str(_SCRIPT), *limits, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
    )


def _told(watcher: subprocess.Popen) -> list[str]:
    """Why it ended and its exit code."""
    assert watcher.stdout
    return watcher.stdout.read().split()[-3:-1]


def _orphan(folder: Path) -> int:
    deadline = time.monotonic() + 60
    while not (path := folder / "pid.orphan").exists() or not path.read_text().strip():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return int(path.read_text())


def test_a_command_ends_by_itself(tmp_path: Path):
    watcher = _watch(tmp_path, "sh", "-c", "echo some words; exit 7")
    assert _told(watcher) == ["ended", "7"]
    assert (tmp_path / "output.txt").read_text() == "some words\n"


@pytest.mark.parametrize(
    ("end", "told"),
    [("exit 0", ["ended", "0"]), ("kill -9 $$", ["ended", "-9"]), ("sleep 99", ["timeout", "-15"])],
)
def test_what_a_command_leaves_behind_is_ended(tmp_path: Path, end: str, told: list[str]):
    limit_s = 2.0 if "sleep 99" in end else 0.0
    watcher = _watch(tmp_path, "sh", "-c", _FAMILY.format(end), timeout_s=limit_s)
    assert _told(watcher) == told
    assert not psutil.pid_exists(_orphan(tmp_path))


def test_pools_of_zenoh_that_a_killed_process_has_open_are_removed(tmp_path: Path):
    pool = Path(f"/dev/shm/of-test-{os.getpid()}.zenoh")
    try:
        watcher = _watch(tmp_path, "sh", "-c", f"exec 3> {pool}; sleep 99 & test -e {pool}")
        assert _told(watcher) == ["ended", "0"]
        assert not pool.exists()
    finally:
        pool.unlink(missing_ok=True)


def test_too_much_memory_ends_it(tmp_path: Path):
    hungry = "import time; b = bytearray(b'x') * 300_000_000; time.sleep(99)"
    watcher = _watch(tmp_path, sys.executable, "-c", hungry, memory_gb=0.2)
    assert _told(watcher) == ["memory", "-15"]


def test_a_starter_that_is_gone_ends_it(tmp_path: Path):
    watcher = _watch(tmp_path, "sh", "-c", _FAMILY.format("sleep 99"))
    orphan = _orphan(tmp_path)
    assert watcher.stdin
    watcher.stdin.close()
    assert _told(watcher) == ["cancelled", "-15"]
    assert not psutil.pid_exists(orphan)


def test_a_killed_watcher_takes_the_command_along(tmp_path: Path):
    watcher = _watch(tmp_path, "sh", "-c", "echo $$ > pid.orphan; exec sleep 99")
    command = psutil.Process(_orphan(tmp_path))
    watcher.kill()
    psutil.wait_procs([command], timeout=30)
    assert not command.is_running() or command.status() == psutil.STATUS_ZOMBIE


_ENDS_AT_THE_SECOND = """
import os, time
from hsslam_services.run.stop_signals import hear_stop_signals
hear_stop_signals(lambda requests: requests > 1 and os._exit(1))
time.sleep(60)
"""


def test_a_run_hears_two_requests_to_end_and_so_ends_at_once(tmp_path: Path):
    """The first alone would let it save and evaluate."""
    watcher = _watch(tmp_path, sys.executable, "-c", _ENDS_AT_THE_SECOND, timeout_s=4.0)
    assert _told(watcher) == ["timeout", "1"]
