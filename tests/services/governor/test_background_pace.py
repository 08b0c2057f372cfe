import threading
import time
from pathlib import Path

import pytest

from hsslam_services.governor.background_pace import BackgroundPace
from hsslam_services.governor.levels import LEVELS
from hsslam_services.governor.shared_level import SharedLevel


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
    assert 0.035 / (time.monotonic() - start_s) <= LEVELS[-1].background_share


def test_nothing_waits_at_the_level_that_gives_up_nothing(level):
    pace = BackgroundPace(level, threading.Event())
    _work(0.5)
    start_s = time.monotonic()
    pace.rest()
    assert time.monotonic() - start_s < 0.3  # at the next level 0.33 s


def test_the_end_of_the_process_ends_a_rest(level):
    level.number = len(LEVELS) - 1
    stop = threading.Event()
    pace = BackgroundPace(level, stop)
    stop.set()
    _work(0.05)
    start_s = time.monotonic()
    pace.rest()
    assert time.monotonic() - start_s < 0.3  # without the end, 0.6 s
