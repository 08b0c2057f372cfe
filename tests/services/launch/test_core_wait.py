"""Which silent processes wait for a core: those that are runnable and get little of one."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from hsslam_services.launch.core_wait import CoreWait

_SPIN = "import os; os.sched_setaffinity(0, [{}])\nprint('ready', flush=True)\nwhile True: pass"
_SLEEP = "import time; print('ready', flush=True); time.sleep(60)"


@pytest.fixture
def start() -> Iterator[Callable[[str], int]]:
    """Start a Python program that prints a line when it is ready; returns its process number."""
    processes: list[subprocess.Popen] = []

    def begin(program: str) -> int:
        processes.append(subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE))
        output = processes[-1].stdout
        assert output and output.readline() == b"ready\n"
        return processes[-1].pid

    yield begin
    for process in processes:
        process.kill()
        process.communicate()


def _is_starved(pid: int) -> bool:
    begin_s = now_s = time.monotonic()
    wait = CoreWait(pid)
    while now_s < begin_s + 2.0:
        now_s = time.monotonic()
        wait.look(now_s)
        time.sleep(0.02)
    return wait.is_starved()


def test_a_process_that_sleeps_or_is_frozen_or_has_ended_waits_for_no_core(start):
    sleeping, frozen = start(_SLEEP), start(_SPIN.format(min(os.sched_getaffinity(0))))
    os.kill(frozen, signal.SIGSTOP)
    assert not _is_starved(sleeping)
    assert not _is_starved(frozen)
    os.kill(sleeping, signal.SIGKILL)
    assert not _is_starved(sleeping)


@pytest.mark.alone
def test_a_process_of_the_lowest_priority_on_a_busy_core_waits_for_it(start):
    core = min(os.sched_getaffinity(0))
    low, _, _ = (start(_SPIN.format(core)) for _ in range(3))
    os.sched_setscheduler(low, os.SCHED_IDLE, os.sched_param(0))
    assert _is_starved(low)


@pytest.mark.alone
def test_a_process_that_turns_in_a_loop_on_a_core_of_its_own_waits_for_none(start):
    assert not _is_starved(start(_SPIN.format(max(os.sched_getaffinity(0)))))


def test_few_looks_say_nothing(start):
    wait = CoreWait(start(_SLEEP))
    wait.look(0.0)
    assert not wait.is_starved()
