"""Rigid transforms: round trips at every angle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.geometry.se3 import (
    inverse,
    quaternion_from_rotation,
    rotation_from_quaternion,
    se3_exp,
    se3_log,
    transform,
)

NUMBER = st.floats(-5, 5, allow_nan=False)
DIRECTION = st.tuples(NUMBER, NUMBER, NUMBER).filter(lambda v: np.linalg.norm(v) > 1e-3)
ANGLE = st.one_of(st.floats(0, np.pi - 1e-4), st.floats(0, 1e-5))


def twist(translation, direction, angle) -> np.ndarray:
    axis = np.array(direction) / np.linalg.norm(direction)
    return np.concatenate([translation, angle * axis])


@given(st.tuples(NUMBER, NUMBER, NUMBER), DIRECTION, ANGLE)
def test_log_undoes_exp(translation, direction, angle):
    xi = twist(translation, direction, angle)
    np.testing.assert_allclose(se3_log(se3_exp(xi)), xi, atol=1e-6)


@given(st.tuples(NUMBER, NUMBER, NUMBER), DIRECTION, ANGLE)
def test_exp_is_rigid_and_its_inverse_is_the_negative_twist(translation, direction, angle):
    xi = twist(translation, direction, angle)
    T = se3_exp(xi)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(inverse(T), se3_exp(-xi), atol=1e-8)
    np.testing.assert_allclose(T @ inverse(T), np.eye(4), atol=1e-9)


@given(DIRECTION, st.floats(0, 2 * np.pi))
def test_quaternions_undo_rotations(direction, angle):
    axis = np.array(direction) / np.linalg.norm(direction)
    q = np.concatenate([np.sin(angle / 2) * axis, [np.cos(angle / 2)]])
    back = quaternion_from_rotation(rotation_from_quaternion(q))
    assert abs(back @ q) == pytest.approx(1, abs=1e-9)


def test_identity_has_no_zero_over_zero():
    assert np.array_equal(se3_exp(np.zeros(6)), np.eye(4))
    assert np.array_equal(se3_log(np.eye(4)), np.zeros(6))


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
def test_half_turns(axis):
    xi = twist((1.0, 2.0, 3.0), axis, np.pi)
    np.testing.assert_allclose(se3_exp(se3_log(se3_exp(xi))), se3_exp(xi), atol=1e-7)


def test_transform_puts_the_parts_together():
    T = transform(np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, 2.0, 2.0]))  # not normalised
    np.testing.assert_allclose(T @ [1, 0, 0, 1], [1, 3, 3, 1], atol=1e-12)
