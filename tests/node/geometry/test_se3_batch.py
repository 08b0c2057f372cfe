"""Batches of transforms against the single ones, and the Jacobian against differences."""

import numpy as np

from hsslam_node.geometry.se3 import inverse, quaternion_from_rotation, se3_exp, se3_log, transform
from hsslam_node.geometry.se3_batch import (
    adjoint_batch,
    exp_batch,
    inverse_batch,
    log_batch,
    log_jacobian_batch,
    quaternions_from_rotations,
    transforms,
)

_TWISTS = np.random.default_rng(0).normal(size=(30, 6)) * np.logspace(-7, 0, 30)[:, None]
_TWISTS[0] = 0.0


def test_exp_log_and_inverse_are_those_of_single_transforms():
    T = exp_batch(_TWISTS)
    np.testing.assert_allclose(T, [se3_exp(x) for x in _TWISTS], atol=1e-12)
    np.testing.assert_allclose(log_batch(T), [se3_log(M) for M in T], atol=1e-9)
    np.testing.assert_allclose(log_batch(T), _TWISTS, atol=1e-9)
    np.testing.assert_allclose(inverse_batch(T), [inverse(M) for M in T], atol=1e-12)


def test_quaternions_are_those_of_single_rotations():
    half_turns = np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])
    R = np.concatenate([exp_batch(3.0 * _TWISTS)[:, :3, :3], half_turns])
    np.testing.assert_array_equal(
        quaternions_from_rotations(R), [quaternion_from_rotation(M) for M in R]
    )
    assert quaternions_from_rotations(R[:0]).shape == (0, 4)


def test_transforms_are_those_of_single_ones():
    T = exp_batch(3.0 * _TWISTS)
    q = 7.0 * quaternions_from_rotations(T[:, :3, :3])
    again = transforms(T[:, :3, 3], q)
    np.testing.assert_allclose(again, T, atol=1e-12)
    np.testing.assert_allclose(again, [transform(M[:3, 3], r) for M, r in zip(T, q, strict=True)])
    assert transforms(T[:0, :3, 3], q[:0]).shape == (0, 4, 4)


def test_the_adjoint_moves_a_twist_to_the_other_side():
    T, x = exp_batch(_TWISTS), _TWISTS[::-1]
    moved = np.einsum("nij,nj->ni", adjoint_batch(T), x)
    np.testing.assert_allclose(T @ exp_batch(x), exp_batch(moved) @ T, atol=1e-12)


def test_the_jacobian_of_the_logarithm_is_its_slope():
    xi = 0.3 * _TWISTS / np.maximum(np.linalg.norm(_TWISTS, axis=1, keepdims=True), 1e-9)
    J = log_jacobian_batch(xi)
    for axis in range(6):
        step = np.zeros((1, 6))
        step[0, axis] = 1e-6
        ahead, behind = (log_batch(exp_batch(xi) @ exp_batch(s * step)) for s in (1, -1))
        np.testing.assert_allclose(J[:, :, axis], (ahead - behind) / 2e-6, atol=1e-5)
