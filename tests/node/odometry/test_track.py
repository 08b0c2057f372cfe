"""Odometry read at the stamps of frames: on the path, a little ahead of it, not across gaps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.errors import UserError
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import se3_exp, transform
from hsslam_node.odometry.reading import MotionSince, OdometryReading
from hsslam_node.odometry.track import OdometryTrack
from hsslam_node.sources.reports import Report, sensor_watch

_SPEED = np.array([0.4, 0.0, 0.0, 0.0, 0.0, 0.5])  # m/s and rad/s of a base that drives a curve
_PERIOD_NS = 20_000_000


def _base_at(stamp_ns: int) -> np.ndarray:
    return transform(np.array([5.0, 1.0, 0.0]), np.array([0.0, 0.0, 0.6, 0.8])) @ se3_exp(
        1e-9 * stamp_ns * _SPEED
    )


def _track(T_base_cam: np.ndarray, count: int = 50) -> OdometryTrack:
    track = OdometryTrack(T_base_cam)
    for k in range(count):
        assert track.add(k * _PERIOD_NS, _base_at(k * _PERIOD_NS))
    return track


def _read(track: OdometryTrack, stamp_ns: int) -> OdometryReading:
    reading = track.at(stamp_ns)
    assert reading is not None
    return reading


@given(st.integers(0, 49 * _PERIOD_NS + 100_000_000))
def test_a_curve_is_read_at_any_stamp_as_the_camera_goes_it(stamp_ns):
    T_base_cam = RobotFrames.mounted((0.2, 0.1, 0.35, -0.5, 0.5, -0.5, 0.5)).T_base_cam
    reading = _read(_track(T_base_cam), stamp_ns)
    np.testing.assert_allclose(reading.T_odom_cam, _base_at(stamp_ns) @ T_base_cam, atol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1.7e308, -1e9])
def test_a_position_that_is_no_reading_is_refused_and_costs_nothing(value):
    track = _track(np.eye(4))
    T = np.eye(4)
    T[1, 3] = value
    with pytest.raises(UserError, match=r"odometry: position \[.*\]: expected at most 1e\+08 m"):
        track.add(50 * _PERIOD_NS, T)
    assert track.add(50 * _PERIOD_NS, _base_at(50 * _PERIOD_NS))
    found = _read(track, 50 * _PERIOD_NS).T_odom_cam
    np.testing.assert_allclose(found, _base_at(50 * _PERIOD_NS), atol=1e-9)


def test_a_covariance_of_the_largest_float_is_unknown_motion_and_no_error():
    track, huge = _track(np.eye(4)), np.full((6, 6), 1.7e308)
    for k in (50, 51):
        assert track.add(k * _PERIOD_NS, _base_at(k * _PERIOD_NS), huge)
    motion = MotionSince()
    motion.restart(_read(track, 49 * _PERIOD_NS))
    found = motion.to(_read(track, 51 * _PERIOD_NS))
    assert found is not None and not found.is_surer_than(1.0, 1.0)


def test_doubt_grows_along_the_path_and_not_at_rest():
    track = _track(np.eye(4))
    traces = [np.trace(_read(track, k * 7_000_000).covariance) for k in range(140)]
    assert (np.diff(traces) > 0).all()
    still = OdometryTrack(np.eye(4))
    for k in range(10):
        still.add(k * _PERIOD_NS, np.eye(4))
    assert np.trace(_read(still, 9 * _PERIOD_NS).covariance) == 0


def test_a_covariance_that_grows_counts_and_a_constant_one_does_not():
    def sigma_m(grows: float, constant: float) -> float:
        track = OdometryTrack(np.eye(4))
        for k in range(50):
            covariance = (constant + grows * k) * np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
            track.add(k * _PERIOD_NS, _base_at(k * _PERIOD_NS), covariance)
        since = MotionSince()
        since.restart(_read(track, 0))
        motion = since.to(_read(track, 49 * _PERIOD_NS))
        assert motion is not None
        return float(np.sqrt(np.linalg.eigvalsh(motion.covariance[:3, :3])[-1]))

    assert sigma_m(0.0, 1e3) == pytest.approx(sigma_m(0.0, 0.0))
    assert sigma_m(1e-4, 1e3) == pytest.approx(np.sqrt(49e-4), rel=0.1)


def test_nothing_is_read_before_the_first_pose_across_a_gap_or_long_after_the_last():
    track = _track(np.eye(4), 5)
    assert track.at(-1) is None
    assert track.at(4 * _PERIOD_NS + 110_000_000) is None
    later = 4 * _PERIOD_NS + 800_000_000
    track.add(later, _base_at(later))
    assert track.at(later - 400_000_000) is None
    assert track.at(later) is not None
    assert not track.add(later, np.eye(4)) and not track.add(0, np.eye(4))


def test_after_a_jump_nothing_is_known_of_the_motion():
    track = _track(np.eye(4), 5)
    since = MotionSince()
    since.restart(_read(track, 4 * _PERIOD_NS))
    track.add(5 * _PERIOD_NS, np.eye(4))  # the driver was restarted
    motion = since.to(_read(track, 5 * _PERIOD_NS))
    assert motion is not None and not motion.is_surer_than(0.5, 0.5)
    since.restart(_read(track, 5 * _PERIOD_NS))
    track.add(6 * _PERIOD_NS, se3_exp(0.02 * _SPEED))
    motion = since.to(_read(track, 6 * _PERIOD_NS))
    assert motion is not None and motion.is_surer_than(0.01, 0.01)
    np.testing.assert_allclose(motion.T_from_to, se3_exp(0.02 * _SPEED), atol=1e-9)


@pytest.mark.parametrize("away_s", [0.6, 3.0])
def test_a_driver_that_restarts_in_a_gap_leaves_the_motion_unknown(away_s: float):
    """After 4 m it begins at its origin again: as slow as a robot may be."""
    track = OdometryTrack(np.eye(4))
    for k in range(200):
        track.add(k * _PERIOD_NS, se3_exp(np.array([0.02 * k, 0.0, 0.0, 0.0, 0.0, 0.0])))
    since = MotionSince()
    since.restart(_read(track, 199 * _PERIOD_NS))
    again_ns = 199 * _PERIOD_NS + round(1e9 * away_s)
    track.add(again_ns, np.eye(4))
    assert track.at(again_ns + 1) is None
    motion = since.to(_read(track, again_ns))
    assert motion is not None and not motion.is_surer_than(0.5, 0.5)
    since.restart(_read(track, again_ns))
    track.add(again_ns + _PERIOD_NS, se3_exp(0.02 * _SPEED))
    motion = since.to(_read(track, again_ns + _PERIOD_NS))
    assert motion is not None and motion.is_surer_than(0.01, 0.01)


def test_a_clock_that_was_set_back_begins_anew_as_after_a_jump():
    told: list[Report] = []
    track = OdometryTrack(np.eye(4), watch=sensor_watch("odom", told.append))
    for k in range(150):  # 3 s at 1 m/s
        track.add(k * _PERIOD_NS, se3_exp(np.array([0.02 * k, 0.0, 0.0, 0.0, 0.0, 0.0])))
    assert not track.add(149 * _PERIOD_NS - 1_000_000_000, np.eye(4))  # overtaken on its way
    since = MotionSince()
    since.restart(_read(track, 149 * _PERIOD_NS))
    for k in range(50):  # the simulator begins anew, the robot stands
        assert track.add(k * _PERIOD_NS, np.eye(4))
    assert [report.kind for report in told] == ["odom: clock set back"]
    assert " by 3.0 s: " in told[0].text
    for k in range(50):
        np.testing.assert_allclose(_read(track, k * _PERIOD_NS).T_odom_cam, np.eye(4))
    motion = since.to(_read(track, 0))
    assert motion is not None and not motion.is_surer_than(0.5, 0.5)
    since.restart(_read(track, 0))
    motion = since.to(_read(track, 49 * _PERIOD_NS))
    assert motion is not None and motion.is_surer_than(0.01, 0.01)


def test_another_track_of_the_same_robot_knows_nothing_of_the_motion_since_the_first():
    """A source that is opened again: its covariance begins at 0, and the odometry may have begun anew."""
    first = OdometryTrack(np.eye(4))
    for k in range(50):
        first.add(k * _PERIOD_NS, _base_at(k * _PERIOD_NS), 1e-3 * k * np.eye(6))
    since = MotionSince()
    since.restart(_read(first, 49 * _PERIOD_NS))
    second = _track(np.eye(4))
    motion = since.to(_read(second, 0))
    assert motion is not None and not motion.is_surer_than(0.5, 0.5)
    since.restart(_read(second, 0))
    motion = since.to(_read(second, 10 * _PERIOD_NS))
    assert motion is not None and motion.is_surer_than(0.02, 0.02)


def test_a_clock_that_was_set_back_a_little_is_found_out_and_gives_no_wrong_pose():
    """By 0.4 s; the robot drives on. Overtaken messages alone change nothing."""
    told: list[Report] = []
    track, back_ns = (
        OdometryTrack(np.eye(4), watch=sensor_watch("odom", told.append)),
        20 * _PERIOD_NS,
    )
    for k in range(50):
        track.add(k * _PERIOD_NS, _base_at(k * _PERIOD_NS))
        track.add((k - 3) * _PERIOD_NS, np.eye(4))
    assert told == []
    np.testing.assert_allclose(_read(track, 49 * _PERIOD_NS).T_odom_cam, _base_at(49 * _PERIOD_NS))
    since = MotionSince()
    since.restart(_read(track, 49 * _PERIOD_NS))
    known = []
    for k in range(50, 70):
        track.add(k * _PERIOD_NS - back_ns, _base_at(k * _PERIOD_NS))
        if k > 50 and (reading := track.at(k * _PERIOD_NS - back_ns)) is not None:
            np.testing.assert_allclose(reading.T_odom_cam, _base_at(k * _PERIOD_NS), atol=1e-9)
            motion = since.to(reading)
            assert motion is not None and not motion.is_surer_than(0.5, 0.5)
            known.append(k)
    assert known == list(range(55, 70))  # after 0.1 s
    assert [report.kind for report in told] == ["odom: clock set back"]
    assert " by 0.4 s: " in told[0].text


def test_one_message_from_the_future_costs_a_tenth_of_a_second():
    track = _track(np.eye(4))
    track.add(70 * _PERIOD_NS, _base_at(50 * _PERIOD_NS))
    unknown = 0
    for k in range(51, 90):
        track.add(k * _PERIOD_NS, _base_at(k * _PERIOD_NS))
        unknown += track.at(k * _PERIOD_NS) is None
    assert unknown <= 6


@pytest.mark.parametrize("phase_ms", range(0, 100, 11))
@pytest.mark.parametrize("late_ms", [1, 45])
def test_odometry_at_10_hz_gives_every_frame_a_reading(late_ms: int, phase_ms: int):
    """Frames at 30 Hz, read when they arrive."""
    track, sent = OdometryTrack(np.eye(4)), 0
    for k in range(30, 130):
        now_ns = k * 33_333_333 + phase_ms * 1_000_000
        while sent * 100_000_000 + late_ms * 1_000_000 <= now_ns:
            track.add(sent * 100_000_000, _base_at(sent * 100_000_000))
            sent += 1
        np.testing.assert_allclose(_read(track, now_ns).T_odom_cam, _base_at(now_ns), atol=1e-9)
    assert track.at((sent - 1) * 100_000_000 + 150_000_001) is None


def test_two_poses_at_nearly_one_time_give_no_speed():
    track = OdometryTrack(np.eye(4))
    track.add(0, np.eye(4))
    track.add(1_000_000, transform(np.array([0.004, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])))
    assert track.at(80_000_000) is None


def test_one_stamp_from_the_future_costs_no_further_poses():
    track = OdometryTrack(np.eye(4))
    track.add(1_700_000_000_000_000_000, np.eye(4))
    assert all(track.add(k * _PERIOD_NS, np.eye(4)) for k in range(100))


@pytest.mark.parametrize("apart_ms", [2.0, 0.2])
def test_poses_stamped_on_receipt_in_bursts_go_on_at_the_speed_of_the_robot(apart_ms):
    """At 100 Hz and 1 m/s; two arrive at a time."""
    track = OdometryTrack(np.eye(4))
    for k in range(20):
        for n in range(2):
            T = se3_exp(np.array([0.01 * (2 * k + n), 0.0, 0.0, 0.0, 0.0, 0.0]))
            track.add(k * _PERIOD_NS + round(n * apart_ms * 1e6), T)
        if k > 4:
            read_ns = k * _PERIOD_NS + 17_000_000
            centre_m = _read(track, read_ns).T_odom_cam[0, 3]
            ahead_m = 0.017 - 1e-3 * apart_ms
            assert centre_m == pytest.approx(0.01 * (2 * k + 1) + ahead_m, abs=1e-6)
    since = MotionSince()
    since.restart(_read(track, 0))
    motion = since.to(_read(track, 19 * _PERIOD_NS))
    assert motion is not None and motion.is_surer_than(0.02, 0.02)


def test_after_a_jump_nothing_is_read_ahead_of_it():
    track = _track(np.eye(4), 5)
    track.add(5 * _PERIOD_NS, np.eye(4))
    assert track.at(5 * _PERIOD_NS + 1) is None
    track.add(6 * _PERIOD_NS, np.eye(4))
    np.testing.assert_allclose(_read(track, 7 * _PERIOD_NS).T_odom_cam, np.eye(4), atol=1e-12)
