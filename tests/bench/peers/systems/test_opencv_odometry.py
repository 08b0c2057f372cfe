"""OpenCV's odometry as a peer: it tracks, and a frame without anything in it is left out."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest

from hsslam_bench.peers.systems.opencv_odometry import against_keyframes, from_frame_to_frame
from hsslam_bench.peers.systems.peer import Estimate
from hsslam_node.evaluation.trajectory.ate import ate
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory
from tests.small_room import room_frames, room_poses, with_black

_COUNT = 24
_Way = Callable[[Iterable[Frame]], Estimate]


def _truth() -> Trajectory:
    stamps_ns = np.array([frame.stamp_ns for frame in room_frames()[:_COUNT]])
    return Trajectory(stamps_ns, room_poses()[:_COUNT])


@pytest.mark.parametrize("way", [from_frame_to_frame, against_keyframes])
def test_every_frame_of_a_room_has_a_pose(way: _Way):
    found = way(room_frames()[:_COUNT])
    error = ate(found.trajectory, _truth())
    assert (error.scored, error.expected) == (_COUNT, _COUNT)
    assert error.rmse_m < 0.01
    assert np.ptp(found.trajectory.positions, axis=0).max() > 0.05  # it did not stand still
    np.testing.assert_array_equal(found.trajectory.T_world_cam[0], np.eye(4))
    assert found.mesh is None


def test_keyframes_drift_less_than_a_chain_of_frames():
    frames = room_frames()[:_COUNT]
    chain, keyed = (
        ate(way(frames).trajectory, _truth()).rmse_m
        for way in (from_frame_to_frame, against_keyframes)
    )
    assert keyed < chain


@pytest.mark.parametrize("way", [from_frame_to_frame, against_keyframes])
def test_a_black_frame_is_lost_and_the_rest_goes_on(way: _Way):
    frames = list(room_frames()[:_COUNT])
    frames[8] = with_black(frames[8])
    found = way(frames).trajectory
    assert frames[8].stamp_ns not in found.stamps_ns
    assert set(found.stamps_ns) >= {frame.stamp_ns for frame in frames[10:]}


def test_no_frame_no_pose():
    assert len(against_keyframes([]).trajectory) == 0
