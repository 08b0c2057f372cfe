"""Scores of a camera in a saved map."""

import numpy as np
import pytest

from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.evaluation.trajectory.localisation import (
    localisation_score,
    map_in_truth,
    overlaps,
)
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.trajectory import Trajectory
from tests.small_room import room_frames, room_poses

_STAMPS = np.arange(40, dtype=np.int64)
_T_TRUTH_MAP = se3_exp(np.array([1.0, -2.0, 0.5, 0.1, 0.2, -0.3]))


def _truth() -> Trajectory:
    return Trajectory(_STAMPS, _T_TRUTH_MAP @ room_poses())


def test_the_worlds_are_brought_together_by_the_keyframes():
    keyframes = Trajectory(_STAMPS[:20:4], room_poses()[:20:4])
    np.testing.assert_allclose(map_in_truth(keyframes, _truth()), _T_TRUTH_MAP, atol=1e-9)


def test_errors_are_those_of_overlapping_frames_and_the_lost_are_counted():
    poses = room_poses().copy()
    poses[30, :3, 3] += (0.0, 0.03, 0.0)
    poses[5, :3, 3] += (0.0, 0.5, 0.0)
    poses[31] = poses[31] @ se3_exp(np.array([0, 0, 0, 0, np.deg2rad(0.5), 0]))
    kept = np.delete(np.arange(40), 39)
    overlapping = _STAMPS >= 20
    estimate = Trajectory(_STAMPS[kept], poses[kept])
    score = localisation_score(estimate, _truth(), overlapping, _T_TRUTH_MAP)
    assert (score.frames, score.overlapping, score.lost, score.outside) == (40, 20, 1, 1)
    assert score.max_m == pytest.approx(0.03) and score.max_deg == pytest.approx(0.5)
    assert score.median_m < 1e-9
    assert (score.elsewhere, score.elsewhere_max_m) == (20, pytest.approx(0.5))
    assert not score.all_within


def test_frames_overlap_where_the_views_saw_what_they_see():
    frames, poses = room_frames(), room_poses()
    views = Views(frames[0].camera, poses[:1], frames[0].depth_m()[None])
    turned = poses[0] @ se3_exp(np.array([0, 0, 0, 0, np.pi, 0]))
    found = overlaps([frames[0], frames[1], frames[1]], np.stack([*poses[:2], turned]), views)
    assert found.tolist() == [True, True, False]
