"""Faults of odometry that only many messages show are reported."""

import numpy as np

from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.odometry.track import OdometryTrack
from hsslam_node.sources.reports import Report, sensor_watch

_PERIOD_NS = 20_000_000


def _at_m(x: float) -> np.ndarray:
    return se3_exp(np.array([x, 0.0, 0.0, 0.0, 0.0, 0.0]))


def test_odometry_in_millimetres_is_reported_also_if_the_robot_stands_first():
    told: list[Report] = []
    track = OdometryTrack(np.eye(4), watch=sensor_watch("odom", told.append))
    for k in range(200):  # 0.5 m/s after 2 s
        track.add(k * _PERIOD_NS, _at_m(10.0 * max(0, k - 100)))
    (report,) = told
    assert report.kind == "odom: too fast for a robot"


def test_a_second_publisher_that_comes_later_is_reported_again_after_an_end():
    told: list[Report] = []
    track = OdometryTrack(np.eye(4), watch=sensor_watch("odom", told.append))
    for k in range(600):
        track.add(k * _PERIOD_NS, _at_m(0.01 * k))
        if 100 < k < 200 or k > 400:
            track.add(k * _PERIOD_NS + _PERIOD_NS // 2, _at_m(5.0 + 0.01 * k))
    assert [report.kind for report in told] == ["odom: too fast for a robot"] * 2


def test_a_driver_that_restarts_now_and_then_is_no_fault():
    told: list[Report] = []
    track = OdometryTrack(np.eye(4), watch=sensor_watch("odom", told.append))
    for k in range(600):
        track.add(k * _PERIOD_NS, _at_m(100.0 * (k // 5)))
    assert told == []


def test_messages_of_another_clock_or_unit_are_reported():
    told: list[Report] = []
    track = OdometryTrack(np.eye(4), watch=sensor_watch("odom", told.append))
    for k in range(100):
        track.add(k * _PERIOD_NS + 3_600_000_000_000, _at_m(0.008 * k))
        assert track.at(k * _PERIOD_NS) is None
    (report,) = told
    assert report.kind == "odom: no message near the frames"
    assert "30 frames in a row, the newest message is 3600.00 s after the frame" in report.text

    told.clear()
    track = OdometryTrack(np.eye(4), watch=sensor_watch("odom", told.append))
    for k in range(100):  # 1 m/s in millimetres
        track.add(k * _PERIOD_NS, _at_m(20.0 * k))
    (report,) = told
    assert report.kind == "odom: too fast for a robot"
    assert "30 of 30 motions count as jumps; expected metres" in report.text


def test_a_gap_and_a_jump_are_no_fault():
    told: list[Report] = []
    track = OdometryTrack(np.eye(4), watch=sensor_watch("odom", told.append))
    for k in range(100):
        x = 0.02 * k + 50 * (k > 20)
        if not 30 < k < 59:
            track.add(k * _PERIOD_NS, _at_m(x))
        track.at(k * _PERIOD_NS)
    assert told == []
