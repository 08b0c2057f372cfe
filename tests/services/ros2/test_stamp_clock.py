"""Stamps of a recording that waited for the first map, on another clock."""

import numpy as np

from hsslam_services.ros2.stamp_clock import StampClock

_START_NS = 1_700_000_000_000_000_000


def test_each_stamp_has_the_offset_of_its_time():
    clock = StampClock()
    source_ns = np.arange(10) * 33_333_333
    np.testing.assert_array_equal(clock.ros_ns(source_ns), source_ns)
    wait_ns = np.where(source_ns > 3 * 33_333_333, 700_000_000, 0)
    ros_ns = source_ns + _START_NS + wait_ns
    for pair in zip(source_ns.tolist(), ros_ns.tolist(), strict=True):
        clock.learn(*pair)
    np.testing.assert_array_equal(clock.ros_ns(source_ns), ros_ns)
    outside = np.array([-(10**9), 10**10])
    np.testing.assert_array_equal(
        clock.ros_ns(outside), outside + _START_NS + np.array([0, 700_000_000])
    )


def test_a_recording_that_is_played_slowly_needs_not_every_frame():
    clock = StampClock()
    source_ns = np.arange(60) * 33_333_333
    ros_ns = _START_NS + np.arange(60) * 50_000_000
    for k in (0, 1, 30, 59):  # of which the process heard
        clock.learn(int(source_ns[k]), int(ros_ns[k]))
    np.testing.assert_allclose(clock.ros_ns(source_ns) - _START_NS, ros_ns - _START_NS, atol=1000)


def test_a_long_recording_at_another_rate_keeps_the_stamps_of_its_first_frames():
    clock = StampClock()
    source_ns = np.arange(20_000) * 33_333_333
    ros_ns = _START_NS + np.arange(20_000) * 16_666_667
    for pair in zip(source_ns.tolist(), ros_ns.tolist(), strict=True):
        clock.learn(*pair)
    off_ns = clock.ros_ns(source_ns) - ros_ns
    assert np.abs(off_ns).max() < 5_000_000


def test_waits_of_any_length_stay_within_the_tolerance():
    generator, clock = np.random.default_rng(0), StampClock()
    source_ns = np.cumsum(generator.integers(20_000_000, 50_000_000, 3000))
    ros_ns = _START_NS + source_ns + np.cumsum(generator.integers(0, 20_000_000, 3000))
    for pair in zip(source_ns.tolist(), ros_ns.tolist(), strict=True):
        clock.learn(*pair)
    assert np.abs(clock.ros_ns(source_ns) - ros_ns).max() <= 5_000_001
