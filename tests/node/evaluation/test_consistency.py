"""Agreement of frames with each other."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.evaluation.consistency import Consistency, consistency
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.source import BadFrame
from tests.small_room import room_frames, room_poses


@pytest.fixture(scope="module")
def frames():
    return room_frames()[::10]


def _trajectory(frames, poses: np.ndarray) -> Trajectory:
    return Trajectory(np.array([f.stamp_ns for f in frames]), poses)


def _consistency(frames, trajectory: Trajectory, gap_frames: int) -> Consistency:
    return consistency(frames, {"here": trajectory}, [gap_frames])["here"][0]


def test_true_poses_agree(frames):
    found = _consistency(frames, _trajectory(frames, room_poses()[::10]), 10)
    assert (found.pairs, found.possible) == (3, 3)
    assert found.depth_median_m < 0.004  # the nearest pixel's depth, on slanted walls
    assert found.one_minus_ncc < 0.05


def test_wrong_poses_disagree_by_their_error(frames):
    poses = room_poses()[::10].copy()
    true = _consistency(frames, _trajectory(frames, poses), 10)
    poses[1::2] = poses[1::2] @ se3_exp(np.array([0, 0, 0.03, 0, 0, 0]))
    moved = _consistency(frames, _trajectory(frames, poses), 10)
    assert moved.depth_median_m == pytest.approx(0.03, abs=0.006)
    turned = room_poses()[::10].copy()
    turned[1::2] = turned[1::2] @ se3_exp(np.array([0, 0, 0, 0, 0.03, 0]))
    assert (
        _consistency(frames, _trajectory(frames, turned), 10).one_minus_ncc
        > true.one_minus_ncc + 0.02
    )


def test_where_the_world_lies_does_not_matter(frames):
    poses = room_poses()[::10]
    T = se3_exp(np.array([1.0, 2.0, -3.0, 0.5, -1.0, 2.0]))
    here = _consistency(frames, _trajectory(frames, poses), 20)
    there = _consistency(frames, _trajectory(frames, T @ poses), 20)
    assert there.depth_median_m == pytest.approx(here.depth_median_m, rel=1e-3)


def test_a_lost_frame_is_a_pair_less(frames):
    found = _consistency(frames, _trajectory(frames[1:], room_poses()[10::10]), 10)
    assert (found.pairs, found.possible) == (2, 3)


def test_a_frame_that_cannot_be_read_makes_no_pair_of_its_neighbours(frames):
    trajectory = _trajectory(frames, room_poses()[::10])
    bad = BadFrame(1, frames[1].stamp_ns, "damaged")
    found = _consistency([frames[0], bad, *frames[2:]], trajectory, 10)
    assert (found.pairs, found.possible) == (1, 3)
    pairs = [frames[2], frames[3]]
    assert found == replace(_consistency(pairs, trajectory, 10), possible=3)


def test_frames_that_see_nothing_in_common_have_no_pair(frames):
    away = np.stack([np.eye(4)] * 4)
    away[1::2, 0, 3] = 100.0
    found = _consistency(frames, _trajectory(frames, away), 10)
    assert found.pairs == 0
    assert np.isnan(found.depth_median_m)


def test_gaps_and_trajectories_are_measured_together_as_alone(frames):
    true, poses = _trajectory(frames, room_poses()[::10]), room_poses()[::10].copy()
    poses[1::2] = poses[1::2] @ se3_exp(np.array([0, 0, 0.03, 0, 0, 0]))
    both = {"true": true, "moved": _trajectory(frames, poses)}
    gaps = (10, 20, 30)
    assert consistency(iter(frames), both, gaps) == {
        name: [_consistency(frames, trajectory, gap) for gap in gaps]
        for name, trajectory in both.items()
    }
