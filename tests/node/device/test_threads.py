"""Calls that are made at once."""

import threading

import pytest

from hsslam_node.device.threads import Threads


def test_results_come_in_the_order_of_the_calls():
    for count in (1, 2, 4):
        threads = Threads(count)
        for _ in range(3):
            assert threads.run([lambda k=k: k for k in range(5)]) == [0, 1, 2, 3, 4]


def test_two_calls_are_made_at_once():
    met = threading.Barrier(2, timeout=20)  # broken if either has to wait for the other
    Threads(2).run([met.wait, met.wait])


def test_one_thread_is_the_callers():
    names = Threads(1).run([lambda: threading.current_thread().name] * 3)
    assert set(names) == {threading.current_thread().name}


@pytest.mark.parametrize("failing", [0, 1])
@pytest.mark.parametrize("count", [1, 2])
def test_an_error_is_raised_when_no_call_is_at_work_any_more(count, failing):
    done = []

    def work(k: int) -> None:
        if k == failing:
            raise ValueError(f"part {k}")
        done.append(k)

    with pytest.raises(ValueError, match=f"part {failing}"):
        Threads(count).run([lambda k=k: work(k) for k in range(2)])
    assert count == 1 or done == [1 - failing]
