"""Shared memory of zenoh: full, or with a limit of locked memory that it would exceed."""

import json
import subprocess
import sys
from collections import Counter

import pytest

from hsslam_services.bus.zenoh_session import shared_memory_settings
from tests.services.ordinary_user import LIMIT_BYTES, as_ordinary_user
from tests.services.small_shared_memory import with_shared_memory

_PUBLISHERS = 5
_POOL = 'settings={"transport/shared_memory/transport_optimization/pool_size": 2 * 2**20}'
_READER = f"""
import sys, time
from hsslam_services.bus.zenoh_session import open_client
heard = []
with open_client(sys.argv[1], {_POOL}) as session:
    subscriber = session.declare_subscriber("large/**", lambda sample: heard.append(str(sample.key_expr)))
    print("ready", flush=True)
    deadline = time.monotonic() + 15
    while len(heard) < 10 * {_PUBLISHERS} and time.monotonic() < deadline:
        time.sleep(0.01)
print(*heard, flush=True)
"""
_WRITER = f"""
import sys, time, zenoh
from hsslam_services.bus.zenoh_session import open_client
with open_client(sys.argv[1], {_POOL}) as session:
    publisher = session.declare_publisher(sys.argv[2], congestion_control=zenoh.CongestionControl.BLOCK)
    while not publisher.matching_status.matching:
        time.sleep(0.01)
    for _ in range(10):
        publisher.put(bytes(500_000))
        time.sleep(0.05)
    sys.stdin.read()  # the pool lives until the reader has all
"""


def test_no_message_is_lost_to_a_limit_of_locked_memory(endpoint):
    reader = _limited(_READER, endpoint)
    assert reader.stdout is not None
    assert reader.stdout.readline() == "ready\n"
    writers = [_limited(_WRITER, endpoint, f"large/{index}") for index in range(_PUBLISHERS)]
    heard = reader.communicate(timeout=30)[0].split()
    for writer in writers:
        writer.communicate("", timeout=30)
    assert Counter(heard) == {f"large/{index}": 10 for index in range(_PUBLISHERS)}
    assert [process.returncode for process in (reader, *writers)] == [0] * (1 + _PUBLISHERS)


@pytest.mark.parametrize("opener", ["open_router", "open_client"])
@pytest.mark.parametrize("limit", [1, 3])  # zenoh panics, aborts
def test_a_limit_of_threads_is_named(opener: str, limit: int):
    code = (
        "import os, resource; from hsslam_services.bus.zenoh_session import *\n"
        f"resource.setrlimit(resource.RLIMIT_NPROC, ({limit}, {limit}))\n"
        "os.geteuid() or os.setuid(54321)  # root has no limit\n"
        f"try: {opener}('tcp/127.0.0.1:9')\n"
        "except UserError as error: print(error)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.startswith("zenoh: can't start new thread: expected room for"), said.stderr
    assert "ulimit -u; docker: --pids-limit" in said.stdout and not said.stderr


def test_what_may_be_locked():
    code = "import hsslam_services.bus.zenoh_session as t; print(t.lockable_bytes())"
    assert _limited(code).communicate(timeout=30)[0] == f"{LIMIT_BYTES}\n"


def test_with_little_room_the_first_camera_alone_sends_through_shared_memory():
    code = (
        "import json; from hsslam_services.bus.zenoh_session import *\n"
        "print(json.dumps([shared_memory_settings(), shared_memory_of_run(False, True),"
        " shared_memory_of_run(True, True), shared_memory_of_run(True, False)]))"
    )
    outside, relayed, camera, other = json.loads(_limited(code).communicate(timeout=30)[0])
    enabled, pool, threshold = (
        f"transport/shared_memory/{name}"
        for name in (
            "enabled",
            "transport_optimization/pool_size",
            "transport_optimization/message_size_threshold",
        )
    )
    assert outside[enabled] is False
    assert relayed == {}
    assert camera[enabled] is other[enabled] is True
    assert 4 * 640 * 480 * 5 < camera[pool] == other[pool] < LIMIT_BYTES
    assert camera[threshold] < 160 * 120 * 5 < 2**30 < other[threshold]


def test_full_shared_memory_is_named(endpoint):
    if not shared_memory_settings()["transport/shared_memory/enabled"]:
        pytest.skip("this machine's limit of locked memory leaves zenoh no shared memory")
    code = (
        "from hsslam_services.bus.zenoh_session import open_client\n"
        f"try: open_client({endpoint!r})\n"
        "except Exception as error: print(type(error).__name__, error)"
    )
    command = [*with_shared_memory("4k"), sys.executable, "-c", code]
    said = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True).stdout
    assert said.startswith("OutOfMemoryError /dev/shm: zenoh needs")
    assert "bytes" in said
    assert "0 are free" in said


def _limited(code: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*as_ordinary_user(), sys.executable, "-c", code, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
