"""Motions between readings, their covariances, and what a covariance that says nothing becomes."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.odometry.noise import USUAL_NOISE, growth
from hsslam_node.odometry.reading import MotionSince, OdometryReading

_STEP = se3_exp(np.array([0.02, 0.0, 0.01, 0.0, 0.03, 0.0]))
_START = se3_exp(np.array([3.0, -2.0, 0.5, 0.4, 1.0, -2.0]))


def _readings(count: int, with_covariance: bool) -> list[OdometryReading]:
    T, covariance = _START, np.zeros((6, 6))
    readings = [OdometryReading.at(T, covariance if with_covariance else None)]
    for _ in range(count):
        covariance = covariance + growth(T, T @ _STEP, USUAL_NOISE)
        T = T @ _STEP
        readings.append(OdometryReading.at(T, covariance if with_covariance else None))
    return readings


def test_the_motion_is_the_same_wherever_the_path_of_odometry_began():
    readings = _readings(5, True)
    since = MotionSince()
    since.restart(readings[0])
    motion = since.to(readings[5])
    assert motion is not None
    np.testing.assert_allclose(motion.T_from_to, np.linalg.matrix_power(_STEP, 5), atol=1e-12)


def test_odometry_without_a_covariance_is_as_sure_as_usual():
    motions = []
    for with_covariance in (True, False):
        first, *later = _readings(8, with_covariance)
        since = MotionSince()
        since.restart(first)
        motions.append([since.to(reading) for reading in later][-1])
    with_own, usual = motions
    assert with_own is not None and usual is not None
    np.testing.assert_allclose(usual.covariance, with_own.covariance, atol=1e-15)
    sigma_m = np.sqrt(np.trace(usual.covariance[:3, :3]) / 3)
    assert 0.8 < sigma_m / (USUAL_NOISE * np.sqrt(8 * 0.0224)) < 1.5  # 8 steps of 2.2 cm


def test_the_same_reading_twice_adds_nothing_and_a_frame_without_one_leaves_no_gap():
    first, *later = _readings(3, True)
    since = MotionSince()
    since.restart(first)
    since.to(later[0])
    once = since.to(later[2])
    assert since.to(None) is None
    again = since.to(later[2])
    assert once is not None and again is not None
    np.testing.assert_allclose(again.covariance, once.covariance, atol=1e-16)
    assert MotionSince().to(first) is None


def test_an_error_of_the_heading_moves_what_follows_sideways():
    turn = np.zeros((6, 6))
    turn[4, 4] = 0.01**2  # about y, once
    since = MotionSince()
    since.restart(OdometryReading.at(np.eye(4), np.zeros((6, 6))))
    since.to(OdometryReading.at(np.eye(4), turn))
    far = se3_exp(np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]))
    motion = since.to(OdometryReading.at(far, turn))
    assert motion is not None
    assert np.sqrt(motion.covariance[0, 0]) == pytest.approx(0.02, rel=0.01)  # 0.01 rad over 2 m
    assert motion.is_surer_than(0.03, 0.02) and not motion.is_surer_than(0.01, 0.02)


@pytest.mark.parametrize("way_m", [2.0, 20.0])
def test_a_way_without_readings_in_between_is_as_unsure_as_one_with_them(way_m: float):
    """Straight ahead; an error of the heading on the way moves its end sideways."""
    ways = [
        se3_exp(np.array([0.0, 0.0, 0.02 * k, 0.0, 0.0, 0.0])) for k in range(round(50 * way_m))
    ]
    covariance, readings = np.zeros((6, 6)), [OdometryReading.at(ways[0], np.zeros((6, 6)))]
    for before, after in pairwise(ways):
        covariance = covariance + growth(before, after, USUAL_NOISE)
        readings.append(OdometryReading.at(after, covariance))
    all_read, ends_read = MotionSince(), MotionSince()
    for since in (all_read, ends_read):
        since.restart(readings[0])
    expected = [all_read.to(reading) for reading in readings][-1]
    found = ends_read.to(readings[-1])
    assert expected is not None and found is not None
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=0.05, atol=1e-9)


def test_a_covariance_that_shrinks_was_corrected_elsewhere_and_makes_nothing_surer():
    since = MotionSince()
    since.restart(OdometryReading.at(np.eye(4), np.eye(6)))
    motion = since.to(OdometryReading.at(_STEP, 0.5 * np.eye(6)))
    assert motion is not None and np.linalg.eigvalsh(motion.covariance)[0] > 0


_twist = st.lists(st.floats(-1.5, 1.5), min_size=6, max_size=6).map(np.array)


@given(_twist)
def test_what_travels_is_read_as_the_same_bits(twist):
    first = OdometryReading.at(se3_exp(twist), growth(np.eye(4), se3_exp(twist), 0.01))
    again = OdometryReading(np.array(first.numbers.tolist()), first.covariance)
    assert (again.T_odom_cam == first.T_odom_cam).all()
    np.testing.assert_allclose(again.T_odom_cam, se3_exp(twist), atol=1e-12)
    assert first.covariance is not None and (first.covariance == first.covariance.T).all()


@given(_twist, st.integers(1, 20))
def test_the_doubt_of_a_way_does_not_depend_on_its_number_of_steps(twist, count):
    whole = growth(np.eye(4), se3_exp(twist), 0.01)
    poses = [se3_exp(twist * k / count) for k in range(count + 1)]
    parts = sum(growth(poses[k], poses[k + 1], 0.01) for k in range(count))
    np.testing.assert_allclose(np.trace(parts), np.trace(whole), rtol=1e-6, atol=1e-12)


def test_numbers_that_are_none_are_refused():
    with pytest.raises(UserError, match=r"odometry: numbers .*expected finite, of shape \(7,\)"):
        OdometryReading(np.full(7, np.nan))
    with pytest.raises(UserError, match=r"odometry: covariance .*expected finite"):
        OdometryReading.at(inverse(_START), np.eye(3))
