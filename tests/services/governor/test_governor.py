from itertools import pairwise

import pytest

from hsslam_services.governor.governor import Governor
from hsslam_services.governor.levels import LEVELS

_PERIOD_S = 1 / 30


class _Camera:
    """Frames at 30 Hz whose clock is `ours_s` behind ours; `latency_s` and drops are given."""

    def __init__(self, governor: Governor) -> None:
        self.governor = governor
        self.index = 0
        self.ours_s = 5.0
        self.paused_s = 0.0
        self.published_s = 0.0
        self.changes: list[tuple[float, int]] = []

    @property
    def now_s(self) -> float:
        return self.index * _PERIOD_S + self.paused_s

    def run(self, seconds: float, latency_s: float, late_every: int = 1, drop: int = 0) -> None:
        end = self.now_s + seconds
        while self.now_s < end:
            self.index += 1 + drop
            late = latency_s if self.index % late_every == 0 else 0.015
            self.published_s = max(self.published_s, self.now_s + late)  # poses come in order
            latency_s_by_stamp = self.published_s - self.now_s + self.ours_s
            if self.governor.frame(self.published_s, drop, self.now_s, latency_s_by_stamp):
                self.changes.append((self.published_s, self.governor.level))


def test_a_fast_machine_gives_nothing_up():
    camera = _Camera(Governor())
    camera.run(120, 0.03)
    assert camera.changes == []


@pytest.mark.parametrize(
    ("how", "levels"),
    [
        ({"latency_s": 0.06, "late_every": 8}, [1, 2, 3, 4, 5, 6]),
        ({"latency_s": 0.09, "late_every": 2}, [2, 4, 6]),
        ({"latency_s": 0.015, "drop": 1}, [2, 4, 6]),
    ],
)
def test_late_and_dropped_frames_go_up_a_level_or_two_at_a_time(how, levels):
    camera = _Camera(Governor())
    camera.run(5, 0.015)
    camera.run(30, **how)
    assert [level for _, level in camera.changes] == levels
    times = [at_s for at_s, _ in camera.changes]
    assert times[0] < 7 and all(b - a >= 2.0 for a, b in pairwise(times))


def test_it_goes_down_slowly_and_more_slowly_if_that_was_too_early():
    camera = _Camera(Governor())
    camera.run(5, 0.015)
    camera.run(4, 0.09)
    camera.run(3, 0.015)
    high = camera.governor.level
    assert high >= 1
    camera.run(5, 0.015)
    assert camera.governor.level == high
    camera.run(5, 0.015)
    assert camera.governor.level == high - 1
    camera.run(4, 0.09)  # it was needed
    back = camera.published_s
    assert camera.governor.level >= high
    camera.run(15, 0.015)
    assert all(at_s <= back for at_s, _ in camera.changes)
    camera.run(200, 0.015)
    assert camera.governor.level == 0


def test_a_stall_every_few_seconds_raises_no_level_and_keeps_none():
    """Eight frames late at once, every 12 s: as by a disk."""
    calm, high = _Camera(Governor()), _Camera(Governor(len(LEVELS) - 1))
    for camera in (calm, high):
        for _ in range(20):
            camera.run(11.75, 0.015)
            camera.run(0.25, 0.2)
    assert calm.changes == []
    assert high.governor.level == 0


def test_one_late_frame_now_and_then_changes_nothing():
    camera = _Camera(Governor())
    camera.run(60, 0.06, late_every=60)
    assert camera.changes == []


@pytest.mark.parametrize(("late_every", "level"), [(150, 0), (50, len(LEVELS) - 1)])
def test_it_goes_down_if_at_most_one_frame_in_a_hundred_is_late(late_every: int, level: int):
    camera = _Camera(Governor(len(LEVELS) - 1))
    camera.run(120, 0.06, late_every=late_every)
    assert camera.governor.level == level


def test_a_gap_and_a_camera_that_counts_anew_are_no_load():
    camera = _Camera(Governor())
    camera.run(5, 0.015)
    governor = camera.governor
    assert not governor.frame(camera.now_s + 60, 0, camera.now_s + 60, 5.015)
    assert not governor.frame(camera.now_s + 61, 0, 0.0, 5.015)
    assert governor.level == 0


@pytest.mark.parametrize("step_s", [-3600.0, 30.0, 3600.0])
def test_a_clock_that_is_set_is_no_load_and_later_load_is_seen(step_s: float):
    camera = _Camera(Governor())
    camera.run(10, 0.015)
    for ours_s in (5.0 + step_s, 5.0):  # our clock, while one frame is in flight
        camera.ours_s = ours_s
        camera.run(_PERIOD_S / 2, 0.015)
    camera.run(90, 0.015)
    for _ in range(2):  # the clock of another machine, for good; the second time in a pause
        camera.ours_s += step_s
        camera.run(90, 0.015)
        camera.paused_s += 60
    assert camera.changes == []
    camera.run(5, 0.09)
    assert camera.governor.level > 0


def test_a_restarted_tracker_goes_on_at_the_level():
    assert Governor(2).level == 2
    assert Governor(99).level == len(LEVELS) - 1


def test_each_level_takes_more_than_the_one_before():
    for a, b in pairwise(LEVELS):
        assert b.in_words
        assert b.mesh_every >= a.mesh_every and b.image_every_s >= a.image_every_s
        assert b.iterations <= a.iterations and b.rays <= a.rays and b.ba_every >= a.ba_every
        of_a, of_b = a.tracking, b.tracking
        assert of_b.keyframes_every >= of_a.keyframes_every and of_b.uses_map <= of_a.uses_map
        assert of_b.uses_surface_points <= of_a.uses_surface_points
    assert (LEVELS[0].iterations, LEVELS[0].rays, LEVELS[0].mesh_every) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("rate_hz", [1, 5, 30])
def test_a_slow_camera_is_judged_by_as_many_frames(rate_hz: int):
    calm, late = Governor(5), Governor()
    published_s = 0.0
    for index in range(120 * rate_hz):
        now_s = index / rate_hz
        calm.frame(now_s + 0.02, 0, now_s, 0.02)
        latency_s = 0.02 if now_s % 20 < 2 else 0.3 + min(1 / rate_hz, 0.2)
        published_s = max(published_s, now_s + latency_s)  # poses come in order
        late.frame(published_s, 0, now_s, published_s - now_s)
    assert calm.level == 0
    assert late.level == len(LEVELS) - 1


def test_a_throttled_service_keeps_its_level_even_if_no_frame_is_late():
    governor = Governor(5)
    for index in range(60 * 30):
        now_s = index / 30
        governor.frame(now_s, 0, now_s, 0.02, throttled_share=0.2)
    assert governor.level == 5
    for index in range(60 * 30, 65 * 30):
        now_s = index / 30
        governor.frame(now_s, 0, now_s, 0.02, throttled_share=0.05)
    assert governor.level == 4
