"""Shared memory of senders is counted; that of a killed one is free before its successor starts."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.dead_pools import (
    bytes_of_pools,
    free_pools,
    pool_bytes,
    pools_of,
    remove_unused_pools,
)
from hsslam_services.bus.zenoh_session import shared_memory_settings

_SENDER = """
import sys
from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.zenoh_session import shared_memory_of_run
from tests.services.wire_samples import frame
settings = shared_memory_of_run(True, True, int(sys.argv[2]))
with Bus(sys.argv[1], "r", "camera", settings=settings) as bus:
    frames = bus.publisher(topics.FRAME, block=True)
    for index in range(int(sys.argv[2]) * 1000, 10**6):
        frames.put(frame(index, width_px=640, height_px=480))
        sys.stdin.readline()
"""


def test_pools_of_the_dead_are_freed_and_no_others(endpoint):
    if not shared_memory_settings()["transport/shared_memory/enabled"]:
        pytest.skip("this machine's limit of locked memory leaves zenoh no shared memory")
    with Bus(endpoint, "r", "tracker") as bus, contextlib.ExitStack() as started:
        frames = bus.subscribe(topics.FRAME, 8)
        for _ in range(2):
            killed = _sender(endpoint, 1, started)
            for _ in range(50):
                _expect(frames, killed, 1)
                if _held_bytes(1):  # zenoh makes the pool beside the first messages
                    break
            assert _held_bytes(1) == pool_bytes(1)
            assert free_pools(2) == 0  # of another process
            with_sender = bytes_of_pools(os.getpid())
            assert with_sender > pool_bytes(1)
            killed.kill()
            killed.wait()
            assert free_pools(1) == pool_bytes(1)
            assert _held_bytes(1) == 0
            freed = with_sender - bytes_of_pools(os.getpid())
            assert freed == pytest.approx(pool_bytes(1), rel=0.01)  # some pages are tables
            assert free_pools(1) == 0


def test_files_of_dead_processes_are_removed_and_no_others(endpoint):
    if not shared_memory_settings()["transport/shared_memory/enabled"]:
        pytest.skip("this machine's limit of locked memory leaves zenoh no shared memory")
    with Bus(endpoint, "r", "tracker") as bus, contextlib.ExitStack() as started:
        frames = bus.subscribe(topics.FRAME, 8)
        sender = _sender(endpoint, 1, started)
        while not (used := pools_of(sender.pid)):
            _expect(frames, sender, 1)
        dead = [Path(f"/dev/shm/{os.getpid()}{end}.zenoh") for end in ("01", "02")]
        for path in dead:
            started.callback(path.unlink, missing_ok=True)
            path.write_bytes(b"table")
        young = dead[1].stat().st_mtime
        for path in (dead[0], *used):
            os.utime(path, (young - 5, young - 5))
        os.utime(dead[1], (young + 5, young + 5))  # another process may be about to lock it
        remove_unused_pools()
        assert [path.exists() for path in dead] == [False, True]
        assert all(path.exists() for path in used)


def test_a_run_whose_router_has_ended_has_no_pools():
    ended = subprocess.Popen(["true"])
    ended.wait()
    assert bytes_of_pools(ended.pid) == 0


def _sender(endpoint: str, number: int, started: contextlib.ExitStack) -> subprocess.Popen:
    environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}
    command = [sys.executable, "-c", _SENDER, endpoint, str(number)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True, env=environment)
    started.callback(process.kill)
    return process


def _expect(frames, sender: subprocess.Popen, number: int) -> None:
    """Frames of this sender come, whole."""
    frames.drain()
    for _ in range(100):
        assert sender.stdin is not None
        sender.stdin.write("\n")
        sender.stdin.flush()
        received = frames.wait(0.2)
        if received is not None and received.index // 1000 == number:
            assert frames.rejected == 0
            return
    raise AssertionError(f"no frame of sender {number}")


def _held_bytes(number: int) -> int:
    """Memory of pools of this size that the router, which is this process, has open."""
    opened = {fd.stat().st_ino: fd.stat() for fd in Path("/proc/self/fd").iterdir() if fd.exists()}
    return sum(512 * of.st_blocks for of in opened.values() if of.st_size == pool_bytes(number))
