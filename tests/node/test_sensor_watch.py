"""Faults of odometry that begin after the first messages are reported, each once."""

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
