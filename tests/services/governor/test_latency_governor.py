from pathlib import Path

import pytest

from hsslam_services.governor.latency_governor import LatencyGovernor, first_level
from hsslam_services.governor.levels import LEVELS
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.governor.throttling import Throttling

_MOST = len(LEVELS) - 1


@pytest.fixture
def level(tmp_path: Path) -> SharedLevel:
    SharedLevel.create(tmp_path)
    return SharedLevel(tmp_path)


@pytest.mark.parametrize(("cores", "number"), [(16.0, 0), (2.0, 0), (1.6, 2), (1.2, 5), (0.5, 5)])
def test_few_cores_begin_at_a_higher_level_and_say_so(
    level: SharedLevel, cores: float, number: int
):
    told: list[str] = []
    governor = LatencyGovernor(level, cores, Throttling(), told.append, lambda _: None)
    assert governor.level == level.number == first_level(cores) == number
    assert bool(told) == (number > 0)
    assert all(f"{cores:.1f} cores" in text for text in told)


def test_a_restarted_tracker_keeps_the_level_and_says_nothing(level: SharedLevel):
    level.number = 3
    told: list[str] = []
    assert LatencyGovernor(level, 2.0, Throttling(), told.append, lambda _: None).level == 3
    assert level.number == 3 and not told


def test_late_poses_raise_the_shared_level_which_is_counted_and_told(level: SharedLevel):
    told: list[str] = []
    counted: list[str] = []
    governor = LatencyGovernor(level, 2.0, Throttling(), told.append, counted.append)

    def run(seconds: range, latency_s: float) -> None:
        for index in range(30 * seconds.start, 30 * seconds.stop):  # a camera of 30 Hz
            at_s = index / 30
            published_s = at_s + latency_s
            governor.frame(published_s, 0, round(1e9 * at_s), round(1e9 * published_s))

    run(range(10), 0.01)
    assert level.number == 0 and counted == ["frames at load level 0"] * 300 and not told
    run(range(10, 13), 0.2)
    assert level.number == governor.level > 0
    assert len(told) == counted.count("load level changes") > 0
    assert told[-1].startswith(f"load level {level.number} of {_MOST} (")


def test_frames_that_come_late_because_their_source_waits_raise_no_level(level: SharedLevel):
    told: list[str] = []
    governor = LatencyGovernor(level, 2.0, Throttling(), told.append, lambda _: None)
    for index in range(20 * 30):  # a camera of 30 Hz; from 10 s on, each read takes 40 ms
        at_s, wait_s = index / 30, 0.04 * (index >= 300)
        published_s = at_s + 0.01 + wait_s
        stamps_ns = round(1e9 * at_s), round(1e9 * published_s)
        governor.frame(published_s, 0, *stamps_ns, source_wait_ns=round(1e9 * wait_s))
    assert level.number == 0 and not told


@pytest.mark.parametrize(("throttled_of_10", "number"), [(2, 5), (0, 3)])
def test_a_throttled_service_keeps_its_level(
    tmp_path: Path, level: SharedLevel, throttled_of_10: int, number: int
):
    (tmp_path / "own").write_text("0::/\n")
    level.number = 5
    throttling = Throttling(tmp_path / "own", tmp_path)
    governor = LatencyGovernor(level, 2.0, throttling, lambda _: None, lambda _: None)
    for index in range(25 * 30):  # a camera of 30 Hz; no frame is late
        at_s = index / 30
        if index % 30 == 0:  # ten periods a second
            periods, throttled = 10 * (index // 30), throttled_of_10 * (index // 30)
            text = f"nr_periods {periods}\nnr_throttled {throttled}\n"
            (tmp_path / "cpu.stat").write_text(text)
        governor.frame(at_s, 0, round(1e9 * at_s), round(1e9 * (at_s + 0.01)))
    assert governor.level == number
