import threading
import time
from pathlib import Path

import pytest

from hsslam_services.governor import background_pace
from hsslam_services.governor.background_pace import BackgroundPace
from hsslam_services.governor.levels import LEVELS
from hsslam_services.governor.shared_level import SharedLevel

pytestmark = pytest.mark.alone  # wall-clock time is compared with core time


@pytest.fixture
def level(tmp_path: Path) -> SharedLevel:
    SharedLevel.create(tmp_path)
    return SharedLevel(tmp_path)


def _work(seconds: float) -> None:
    """Use core time."""
    end_s = time.thread_time() + seconds
    while time.thread_time() < end_s:
        pass


def test_background_work_takes_its_share_of_a_core_however_it_comes(level):
    level.number = len(LEVELS) - 1
    pace = BackgroundPace(level, threading.Event())
    start_s = time.monotonic()
    for piece_s in (0.02, 0.005, 0.01):
        _work(piece_s)
        pace.rest()
    elapsed_s = time.monotonic() - start_s
    assert 0.035 / elapsed_s <= LEVELS[-1].background_share and elapsed_s < 3.0  # 0.44 s are due


def test_nothing_waits_at_the_level_that_gives_up_nothing(level):
    pace = BackgroundPace(level, threading.Event())
    _work(0.5)
    start_s = time.monotonic()
    pace.rest()
    assert time.monotonic() - start_s < 0.3  # at the next level 0.33 s


def test_one_rest_has_an_end(level, monkeypatch):
    monkeypatch.setattr(background_pace, "_LONGEST_S", 0.1)
    level.number = len(LEVELS) - 1
    pace = BackgroundPace(level, threading.Event())
    _work(0.1)
    start_s = time.monotonic()
    pace.rest()
    assert 0.1 <= time.monotonic() - start_s < 0.6  # without the limit 1.15 s


def test_the_end_of_the_process_ends_a_rest(level):
    level.number = len(LEVELS) - 1
    stop = threading.Event()
    pace = BackgroundPace(level, stop)
    stop.set()
    _work(0.05)
    start_s = time.monotonic()
    pace.rest()
    assert time.monotonic() - start_s < 0.3  # without the end, 0.6 s
