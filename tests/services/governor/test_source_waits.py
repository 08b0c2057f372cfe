"""Frames are late by the waits of their source only if it neither ran nor waited for a core."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from hsslam_node.sources.source import BadFrame
from hsslam_services.governor.source_waits import ReadItem, SourceWaits

_PERIOD_S = 0.02
_SPIN = "import os; os.sched_setaffinity(0, [{}])\nprint('ready', flush=True)\nwhile True: pass"


def _read(
    get: Callable[[], object], count: int, late_after: int = 0, skips: bool = False
) -> list[ReadItem]:
    """Reads items that are due one period apart, in a thread of its own; those before `late_after` at any
    time. `skips`: leaves out, unread, those that come half a period too late."""
    begin_ns = time.monotonic_ns()

    def items() -> Iterator[BadFrame]:
        for index in range(count):
            if not skips or lag_ns(index) < 0.5e9 * _PERIOD_S:
                get()
            yield BadFrame(index, index, "")

    def lag_ns(index: int) -> int:
        if index < late_after:
            return -1
        return time.monotonic_ns() - begin_ns - round(1e9 * _PERIOD_S * index)

    found: list[ReadItem] = []
    reader = threading.Thread(target=lambda: found.extend(SourceWaits(lag_ns).timed(items())))
    reader.start()
    reader.join()
    return found


def _wait() -> None:
    threading.Event().wait(1.5 * _PERIOD_S)


def _work(periods: float = 1.5) -> None:
    end_s = time.thread_time() + periods * _PERIOD_S
    while time.thread_time() < end_s:
        pass


def test_a_source_that_waits_is_the_cause_of_its_late_frames():
    last = _read(_wait, 30)[-1]
    assert last.lag_ns > 1e9 * 14 * _PERIOD_S
    assert last.wait_ns > 0.8 * last.lag_ns
    assert last.is_late_by_wait


def test_a_source_that_works_is_not():
    last = _read(_work, 30)[-1]
    assert last.lag_ns > 1e9 * 14 * _PERIOD_S
    assert last.wait_ns < 0.2 * last.lag_ns
    assert not last.is_late_by_wait


@pytest.mark.alone
def test_a_source_that_waits_for_a_core_is_not():
    core = min(os.sched_getaffinity(0))
    spin = [sys.executable, "-c", _SPIN.format(core)]
    with subprocess.Popen(spin, stdout=subprocess.PIPE) as other:
        assert other.stdout and other.stdout.readline() == b"ready\n"

        def work_on_the_busy_core() -> None:
            os.sched_setaffinity(0, [core])  # of this thread
            _work(0.9)

        last = _read(work_on_the_busy_core, 30)[-1]
        other.kill()
    assert last.lag_ns > 1e9 * 5 * _PERIOD_S
    assert not last.is_late_by_wait


def test_waits_of_a_source_that_was_in_time_again_are_forgotten():
    found = _read(_wait, 30, late_after=29)
    assert [item.wait_ns for item in found[:29]] == [0] * 29
    assert found[29].wait_ns < 1e9 * 2.5 * _PERIOD_S


def test_one_wait_does_not_hide_that_the_source_works_too_slowly():
    first = iter([_wait])

    def wait_once_and_work() -> None:
        next(first, lambda: None)()
        _work(1.3)

    found = _read(wait_once_and_work, 100, skips=True)
    late = [item for item in found if item.lag_ns > 0.5e9 * _PERIOD_S]
    assert len(late) > 20
    assert sum(item.is_late_by_wait for item in late) < 5


def test_time_in_which_nobody_takes_the_items_is_no_wait():
    begin_ns = time.monotonic_ns()
    items = SourceWaits(lambda _: time.monotonic_ns() - begin_ns).timed(
        BadFrame(index, index, "") for index in range(3)
    )
    next(items)
    threading.Event().wait(0.2)
    last = next(items)
    assert last.lag_ns > 0.2e9
    assert last.wait_ns < 0.1e9
