"""The hand-held motion."""

from itertools import pairwise

import numpy as np
import pytest

from hsslam_node.geometry.se3 import inverse, se3_log
from hsslam_node.synth.scenes.room_motion import hand_held_poses

SIZE = (5.6, 4.6, 2.6)


def steps(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Translation (m) and rotation (degrees) from each pose to the next."""
    twists = [se3_log(inverse(a) @ b) for a, b in pairwise(poses)]
    norms = np.array([[np.linalg.norm(t[:3]), np.linalg.norm(t[3:])] for t in twists])
    return norms[:, 0], np.rad2deg(norms[:, 1])


@pytest.mark.parametrize("length", [60, 300, 600, 1300])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_speed_is_that_of_a_hand_and_the_loop_closes(length, seed):
    poses = hand_held_poses(SIZE, length, seed)
    translation, rotation = steps(np.concatenate([poses, poses[:1]]))  # the last step closes it
    assert translation.max() < 0.02
    assert rotation.max() < 0.9
    if length == 600:
        assert translation.mean() == pytest.approx(0.011, abs=0.003)


def test_rotations_are_rotations_and_the_camera_is_upright():
    R = hand_held_poses(SIZE, 600, 0)[:, :3, :3]
    np.testing.assert_allclose(
        R @ R.swapaxes(1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(R), 1)
    assert (R[:, 2, 1] < -0.7).all()  # the image's y axis points down


@pytest.mark.parametrize("size_m", [(4.0, 4.0, 2.4), SIZE, (10.0, 10.0, 4.0)])
def test_the_camera_keeps_away_from_the_walls(size_m):
    positions = hand_held_poses(size_m, 600, 0)[:, :3, 3]
    assert (positions > 0.9).all()
    assert (positions < np.array(size_m) - 0.9).all()


def test_all_walls_come_into_view():
    forward = hand_held_poses(SIZE, 600, 0)[:, :2, 2]
    heading = np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))
    assert np.ptp(heading) > np.deg2rad(350)
