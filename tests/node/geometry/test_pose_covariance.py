"""Covariances of poses: of one alignment, and along a chain of keyframes."""

import numpy as np
import pytest

from hsslam_node.geometry.pose_covariance import Evidence, in_world, of_new_keyframe
from hsslam_node.geometry.se3 import inverse, moved_about_camera, se3_exp, so3_log


def _information(rng: np.random.Generator, rows: int) -> np.ndarray:
    J = rng.normal(size=(rows, 8))
    return J.T @ J


@pytest.fixture
def terms() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return _information(rng, 40), _information(rng, 60)


@pytest.mark.parametrize(("points", "pixels", "is_averaged"), [(1.5, 5, False), (0.5, 6, True)])
def test_residuals_as_large_as_assumed_give_the_inverse_times_the_correlation(
    terms, points, pixels, is_averaged
):
    surface, photometric = terms
    H = surface + photometric
    own = Evidence(H, surface, photometric, 1 / points, 1 / pixels, is_averaged).covariance()
    np.testing.assert_allclose(own, np.linalg.inv(H)[:6, :6], rtol=1e-9)


def test_a_term_with_larger_residuals_makes_the_pose_less_sure(terms):
    surface, photometric = terms
    H = surface + photometric
    usual = Evidence(H, surface, photometric, 1.0, 1.0).covariance()
    np.testing.assert_allclose(
        Evidence(H, surface, photometric, 3.0, 3.0).covariance(), 3 * usual, rtol=1e-9
    )
    worse = Evidence(H, surface, photometric, 1.0, 3.0).covariance()
    assert (np.linalg.eigvalsh(worse - usual) > 0).all()


def test_a_perfect_image_does_not_make_the_pose_certain(terms):
    surface, photometric = terms
    still = Evidence(surface + photometric, surface, photometric, 0.0, 0.0).covariance()
    assert (np.linalg.eigvalsh(still) > 0).all()


def test_the_errors_of_keyframe_and_frame_add_up_at_the_frame():
    rng = np.random.default_rng(1)
    scale = np.diag([2e-3, 1e-3, 3e-3, 1e-3, 2e-3, 4e-4])
    of_keyframe, own = (scale @ (A @ A.T) @ scale for A in rng.normal(size=(2, 6, 6)))
    T_world_key = se3_exp(np.array([1.0, -2.0, 0.5, 0.3, -0.4, 1.1]))
    T_world_cam = se3_exp(np.array([1.9, -1.2, 0.9, 0.5, -0.1, 0.8]))
    T_key_cam = inverse(T_world_key) @ T_world_cam
    errors = []
    draws = zip(
        rng.multivariate_normal(np.zeros(6), of_keyframe, 20_000),
        rng.multivariate_normal(np.zeros(6), own, 20_000),
        strict=True,
    )
    for of_key, of_cam in draws:
        T = moved_about_camera(moved_about_camera(T_world_key, of_key) @ T_key_cam, of_cam)
        turn = so3_log(T[:3, :3] @ T_world_cam[:3, :3].T)
        errors.append(np.concatenate([T[:3, 3] - T_world_cam[:3, 3], turn]))
    lever_m = T_world_cam[:3, 3] - T_world_key[:3, 3]
    expected = in_world(own, of_keyframe, lever_m)
    deviation = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        np.cov(np.array(errors).T) / np.outer(deviation, deviation),
        expected / np.outer(deviation, deviation),
        atol=0.05,
    )


def test_a_new_keyframe_is_surer_than_its_frame_and_less_sure_than_the_one_before(terms):
    own = np.linalg.inv(terms[0])[:6, :6]
    before = 2 * own
    new = of_new_keyframe(own, before, np.zeros(3))
    assert (np.linalg.eigvalsh(new - before) > 0).all()
    assert (np.linalg.eigvalsh(in_world(own, before, np.zeros(3)) - new) > 0).all()
