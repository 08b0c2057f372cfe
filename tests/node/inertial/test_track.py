"""Readings at the stamps of frames, from samples of an IMU that turns and moves in known ways."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import se3_exp, so3_exp
from hsslam_node.inertial.reading import ImuReading, motion_between
from hsslam_node.inertial.track import ImuTrack
from hsslam_node.sources.reports import Report, sensor_watch

_START_NS = 1_700_000_000_000_000_000
_STEP_NS = 5_000_000
_UP = np.array([0.0, -9.81, 0.0])  # at rest, camera level
vectors = arrays(np.float64, 3, elements=st.floats(-2.0, 2.0))


def _turning(turn_rate: np.ndarray, count: int, T_cam_imu: np.ndarray | None = None) -> ImuTrack:
    """Of a camera that turns evenly about its centre, without gravity."""
    T = np.eye(4) if T_cam_imu is None else T_cam_imu
    force = np.cross(turn_rate, np.cross(turn_rate, T[:3, 3]))  # of the IMU beside the centre
    track = ImuTrack(T)
    for k in range(count):
        R = T[:3, :3].T
        assert track.add(_START_NS + k * _STEP_NS, R @ turn_rate, R @ force)
    return track


@settings(max_examples=30, deadline=None)
@given(vectors, st.integers(0, 99), st.integers(100, 190))
def test_an_even_turn_is_integrated_exactly_at_any_stamp(turn_rate, before, after):
    track = _turning(turn_rate, 40)
    one, two = (track.at(_START_NS + 1_000_000 * ms) for ms in (before, after))
    motion = motion_between(one, two)
    assert motion is not None
    seconds = 1e-3 * (after - before)
    assert motion.seconds == pytest.approx(seconds)
    np.testing.assert_allclose(motion.rotation, so3_exp(seconds * turn_rate), atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(vectors, arrays(np.float64, 6, elements=st.floats(-0.5, 0.5)))
def test_an_imu_beside_the_camera_says_the_same_of_the_camera(turn_rate, mounting):
    """The camera turns about its own centre, which does not move, wherever the IMU is."""
    track = _turning(turn_rate, 41, se3_exp(mounting))
    motion = motion_between(track.at(_START_NS), track.at(_START_NS + 200_000_000))
    assert motion is not None
    np.testing.assert_allclose(motion.rotation, so3_exp(0.2 * turn_rate), atol=1e-9)
    np.testing.assert_allclose(motion.velocity_change, 0.0, atol=2e-3)


def test_readings_in_between_may_be_missing():
    track = ImuTrack()
    rng = np.random.default_rng(0)
    for k in range(60):
        track.add(_START_NS + k * _STEP_NS, rng.normal(size=3), _UP + rng.normal(size=3))
    first, middle, last = (track.at(_START_NS + 50_000_000 * n) for n in (0, 2, 5))
    whole, *parts = (
        motion_between(a, b) for a, b in ((first, last), (first, middle), (middle, last))
    )
    assert whole is not None and parts[0] is not None and parts[1] is not None
    np.testing.assert_allclose(whole.rotation, parts[0].rotation @ parts[1].rotation, atol=1e-12)
    summed = parts[1].rotation.T @ parts[0].velocity_change + parts[1].velocity_change
    np.testing.assert_allclose(whole.velocity_change, summed, atol=1e-9)


def test_a_gap_a_late_sample_and_silence():
    track = ImuTrack()
    for k in (0, 1, 2, 40, 41):  # a gap of 190 ms
        assert track.add(_START_NS + k * _STEP_NS, np.zeros(3), _UP)
    assert not track.add(_START_NS + 20 * _STEP_NS, np.zeros(3), _UP)
    assert track.at(_START_NS - 1) is None
    assert track.at(_START_NS + 20 * _STEP_NS) is None  # in the gap
    before, after = track.at(_START_NS + _STEP_NS), track.at(_START_NS + 41 * _STEP_NS)
    assert before is not None and after is not None
    assert motion_between(before, after) is None and motion_between(before, None) is None
    newest_ns = _START_NS + 41 * _STEP_NS
    ahead = track.at(newest_ns + 60_000_000)
    assert ahead is not None and track.at(newest_ns + 60_000_001) is None
    motion = motion_between(after, ahead)
    assert motion is not None
    np.testing.assert_allclose(motion.velocity_change, 0.06 * _UP, atol=1e-12)


@pytest.mark.parametrize("phase_ms", [0, 5, 15, 30])
@pytest.mark.parametrize("late_ms", [1, 20])
def test_batches_at_30_hz_give_every_frame_a_reading(late_ms: int, phase_ms: int):
    """Samples at 200 Hz; frames at 30 Hz, read when they arrive, at any phase of the batches."""
    track, turn_rate, batches, sent = ImuTrack(), np.array([0.0, 0.5, 0.0]), 0, 0
    readings = []
    for k in range(30, 130):
        now_ns = k * 33_333_333 + phase_ms * 1_000_000
        while (batches + 1) * 33_333_333 + late_ms * 1_000_000 <= now_ns:
            batches += 1
            while sent * _STEP_NS <= batches * 33_333_333:
                track.add(sent * _STEP_NS, turn_rate, _UP)
                sent += 1
        readings.append(track.at(now_ns))
    motion = motion_between(readings[0], readings[-1])
    assert None not in readings and motion is not None
    turned = so3_exp(99 * 0.033333333 * turn_rate)
    np.testing.assert_allclose(motion.rotation, turned, atol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, -1e6])
@pytest.mark.parametrize("of_turn", [True, False])
def test_a_sample_that_is_no_reading_is_refused_and_costs_nothing(of_turn, value):
    track, wrong = ImuTrack(), np.array([0.0, value, 0.0])
    assert track.add(0, np.zeros(3), _UP)
    given = (wrong, _UP) if of_turn else (np.zeros(3), wrong)
    with pytest.raises(UserError, match=r"imu: angular velocity .*: expected at most 1000 and 1"):
        track.add(_STEP_NS, *given)
    assert track.add(2 * _STEP_NS, np.zeros(3), _UP)
    first, last = track.at(0), track.at(2 * _STEP_NS)
    assert first is not None and last is not None
    motion = motion_between(first, last)
    assert motion is not None
    np.testing.assert_allclose(motion.velocity_change, 2e-9 * _STEP_NS * _UP, atol=1e-12)


@pytest.mark.parametrize("stamp_ns", [(1 << 63) - 1, 1 << 62, -1])
def test_a_stamp_that_is_no_time_is_refused_and_costs_nothing(stamp_ns):
    """Its series would be no number of a message."""
    track = ImuTrack()
    assert track.add(_START_NS, np.zeros(3), _UP)
    with pytest.raises(UserError, match=rf"imu: stamp {stamp_ns}: expected 0 to 2\^62 ns"):
        track.add(stamp_ns, np.zeros(3), _UP)
    assert track.add(_START_NS + _STEP_NS, np.zeros(3), _UP)
    first, last = track.at(_START_NS), track.at(_START_NS + _STEP_NS)
    assert first is not None and last is not None and first.series == last.series == _START_NS


@pytest.mark.parametrize("numbers", [np.zeros(8), np.full(8, np.nan), np.ones(7)])
def test_a_reading_of_other_numbers_is_refused(numbers):
    with pytest.raises(UserError, match=r"imu .*: expected 8 finite numbers"):
        ImuReading(numbers, 0)


def test_a_clock_that_was_set_back_begins_a_series_with_a_name_of_its_own():
    told: list[Report] = []
    track = ImuTrack(watch=sensor_watch("imu", told.append))
    series = []
    for turn_rate in (np.array([0.0, 0.5, 0.0]), np.zeros(3), np.zeros(3)):
        for k in range(400):  # 2 s, from the same stamp each time
            assert track.add(k * _STEP_NS, turn_rate, _UP)
        assert not track.add(300 * _STEP_NS, turn_rate, _UP)  # overtaken on its way
        last, middle = track.at(399 * _STEP_NS), track.at(200 * _STEP_NS)
        motion = motion_between(middle, last)
        assert motion is not None and last is not None
        assert motion.seconds == pytest.approx(199 * 0.005)
        np.testing.assert_allclose(motion.rotation, so3_exp(199 * 0.005 * turn_rate), atol=1e-9)
        assert last.seconds == pytest.approx(399 * 0.005)
        series.append(last.series)
    assert len(set(series)) == 3
    assert [report.kind for report in told] == ["imu: clock set back"] * 2
    assert all(" by 2.0 s: " in report.text for report in told)


def test_a_clock_that_was_set_back_a_little_begins_a_series_after_a_tenth_of_a_second():
    told: list[Report] = []
    track = ImuTrack(watch=sensor_watch("imu", told.append))
    for k in range(400):
        assert track.add(k * _STEP_NS, np.zeros(3), _UP)
    before = track.at(399 * _STEP_NS)
    taken = [track.add(k * _STEP_NS, np.zeros(3), _UP) for k in range(300, 390)]
    assert taken == [False] * 20 + [True] * 70
    after = track.at(389 * _STEP_NS)
    assert before is not None and after is not None and after.series != before.series
    assert [report.kind for report in told] == ["imu: clock set back"]


def test_samples_of_another_clock_are_reported():
    told: list[Report] = []
    track = ImuTrack(watch=sensor_watch("imu", told.append))
    for k in range(40):
        track.add(k * _STEP_NS, np.zeros(3), _UP)
        assert track.at(k * _STEP_NS + 5_000_000_000) is None
    (report,) = told
    assert report.kind == "imu: no message near the frames"
    assert "the newest message is 5.00 s before the frame" in report.text
