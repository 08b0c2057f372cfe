"""PSS: what is shared is counted once, what one process has is counted there."""

import mmap
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from hsslam_services.run.memory import (
    MemoryOfAll,
    OwnMemory,
    read_pss_mb,
    return_free_memory,
)


def test_own_pages_count_whole_and_shared_ones_by_their_share():
    before = read_pss_mb()
    block = np.ones(400 * 10**6, np.uint8)
    alone = read_pss_mb()  # processes of other tests may end, and leave this one their share
    assert alone - before == pytest.approx(400, abs=60)
    child = os.fork()
    if child == 0:
        signal.pause()
    time.sleep(0.2)
    together = read_pss_mb() + read_pss_mb(child)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    assert together == pytest.approx(alone, abs=60)
    assert len(block) > mmap.PAGESIZE


def test_a_process_that_is_gone_has_none():
    assert read_pss_mb(2**22 + 1) == 0


def test_it_is_measured_now_and_then():
    memory = OwnMemory()
    first = memory.pss_mb()
    block = np.ones(200 * 10**6, np.uint8)
    assert memory.pss_mb() == first > 0
    assert block.any()


def test_the_peak_is_of_one_moment():
    memory = MemoryOfAll()
    for tracker, mapper in ((500, 300), (200, 400)):
        memory.look({"tracker": tracker, "mapper": mapper}, None)
    found = memory.section()["memory"]
    own = found["peak_pss_mb_of"]["supervisor"]
    assert own > 0
    assert memory.total_mb == 600 + own
    assert memory.peak_mb == found["peak_pss_mb"] == 800 + own
    assert found["peak_pss_mb_of"] == {
        "tracker": 500, "mapper": 400, "supervisor": own, "fork_server": 0,
    }  # fmt: skip


def test_free_memory_between_arrays_in_use_is_given_back():
    arrays = [
        np.ones(100_000, np.uint8) for _ in range(1000)
    ]  # below glibc's own limit for a mapping
    kept = arrays[::100]
    del arrays
    before = read_pss_mb()
    return_free_memory()
    assert before - read_pss_mb() > 50
    assert all(array.all() for array in kept)


_FREED = """
import numpy as np
from hsslam_services.run.memory import read_pss_mb, return_large_arrays
if {returns}:
    return_large_arrays()
arrays = [np.ones(1_000_000, np.uint8) for _ in range(200)]
last, before = arrays[-1], read_pss_mb()
del arrays
print(before - read_pss_mb())
"""


@pytest.mark.parametrize("returns", [True, False])
def test_large_arrays_go_back_once_they_are_freed_where_a_process_says_so(returns):
    kept = {"MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(128 << 20)}
    command = [sys.executable, "-c", _FREED.format(returns=returns)]
    found = subprocess.run(command, env=os.environ | kept, capture_output=True, text=True)
    assert (float(found.stdout) > 150) == returns, found.stderr
