"""Walking with a camera."""

import numpy as np
import pytest

from hsslam_node.synth.scenes.walk import walk_poses

_SQUARE_M = np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0)])


def _turns_deg(poses: np.ndarray) -> np.ndarray:
    """Rotation from each pose to the next, degrees."""
    R = poses[:, :3, :3]
    cosine = (np.einsum("nij,nij->n", R[:-1], R[1:]) - 1) / 2
    return np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize("seed", [0, 1])
def test_one_round_is_smooth_and_ends_where_it_began(seed):
    poses = walk_poses(_SQUARE_M, None, seed)
    ring = np.concatenate([poses, poses[:1]])
    steps_m = np.linalg.norm(np.diff(ring[:, :3, 3], axis=0), axis=1)
    assert 17 < steps_m.sum() < 20  # 20 m along the square, with its corners cut
    assert steps_m.min() > 0.015 and steps_m.max() < 0.035  # at 30 Hz: 0.45 to 1.05 m/s
    assert _turns_deg(ring).max() < 2.0


def test_eyes_are_where_the_way_leads():
    poses = walk_poses(_SQUARE_M, None, 0)
    forward, step = poses[:-1, :2, 2], np.diff(poses[:, :2, 3], axis=0)
    cosine = (
        (forward * step).sum(1) / np.linalg.norm(forward, axis=1) / np.linalg.norm(step, axis=1)
    )
    assert cosine.min() > np.cos(np.deg2rad(75))
    assert cosine.mean() > np.cos(np.deg2rad(25))


def test_a_longer_walk_goes_round_again_and_a_shorter_one_stops():
    one = walk_poses(_SQUARE_M, None, 0)
    n = len(one)
    np.testing.assert_array_equal(walk_poses(_SQUARE_M, 2 * n + 5, 0)[n : n + 5], one[:5])
    np.testing.assert_array_equal(walk_poses(_SQUARE_M, 40, 0), one[:40])


def test_poses_are_rigid_and_upright():
    R = walk_poses(_SQUARE_M, 200, 0)[:, :3, :3]
    np.testing.assert_allclose(
        R @ R.swapaxes(1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(R), 1)
    assert (R[:, 2, 1] < -0.8).all()  # the image's y axis points down
