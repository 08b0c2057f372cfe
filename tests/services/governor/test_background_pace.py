"""Rests are what the pace asks an event to wait, so that the load of the machine does not change them."""

import threading
import time
from pathlib import Path

import pytest

from hsslam_services.governor import background_pace
from hsslam_services.governor.background_pace import BackgroundPace
from hsslam_services.governor.levels import LEVELS
from hsslam_services.governor.shared_level import SharedLevel


class _Rests(threading.Event):
    """Stands for the end of a process: `wait` notes how long it is asked to wait, and returns at once."""

    def __init__(self) -> None:
        super().__init__()
        self.asked_s: list[float] = []

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.asked_s.append(timeout)
        return False


@pytest.fixture
def level(tmp_path: Path) -> SharedLevel:
    SharedLevel.create(tmp_path)
    return SharedLevel(tmp_path)


def _work(seconds: float) -> None:
    """Use core time."""
    end_s = time.thread_time() + seconds
    while time.thread_time() < end_s:
        pass


@pytest.mark.parametrize("number", range(len(LEVELS)))
def test_background_work_takes_its_share_of_a_core_however_it_comes(level, number):
    level.number = number
    rests = _Rests()
    begin_s = time.thread_time()
    pace = BackgroundPace(level, rests)
    for piece_s in (0.02, 0.005, 0.01):
        _work(piece_s)
        pace.rest()
    worked_s = time.thread_time() - begin_s
    share = LEVELS[number].background_share
    assert sum(rests.asked_s) == pytest.approx(0.035 * (1 / share - 1), rel=0.2)
    assert worked_s / (worked_s + sum(rests.asked_s)) == pytest.approx(share, rel=0.2)


def test_nothing_waits_at_the_level_that_gives_up_nothing(level):
    rests = _Rests()
    pace = BackgroundPace(level, rests)
    _work(0.05)
    pace.rest()
    assert LEVELS[0].background_share == 1.0 and not rests.asked_s


def test_one_rest_has_an_end(level, monkeypatch):
    monkeypatch.setattr(background_pace, "_LONGEST_S", 0.1)
    level.number = len(LEVELS) - 1
    rests = _Rests()
    pace = BackgroundPace(level, rests)
    _work(0.1)
    pace.rest()
    assert rests.asked_s == [0.1]  # without the limit 1.15 s


def test_the_end_of_the_process_ends_a_rest(level):
    level.number = len(LEVELS) - 1
    stop = threading.Event()
    pace = BackgroundPace(level, stop)
    _work(1.0)
    threading.Timer(0.1, stop.set).start()
    start_s = time.monotonic()
    pace.rest()
    assert time.monotonic() - start_s < 4.0  # without the end, 5 s
