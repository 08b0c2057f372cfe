"""Open3D's dense SLAM as a peer: poses, and a mesh in their world."""

import numpy as np
import pytest

from hsslam_bench.peers.systems.open3d_slam import frame_to_model
from hsslam_node.errors import UserError
from hsslam_node.evaluation.mesh.mesh_metrics import distances
from hsslam_node.evaluation.trajectory.ate import ate
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.trajectory import Trajectory
from tests.small_room import room_frames, room_poses

pytest.importorskip("open3d", exc_type=ImportError)
_COUNT = 10


def test_poses_of_a_room_and_its_surface():
    frames = room_frames()[:_COUNT]
    found = frame_to_model(frames)
    stamps_ns = np.array([frame.stamp_ns for frame in frames])
    error = ate(found.trajectory, Trajectory(stamps_ns, room_poses()[:_COUNT]))
    assert error.scored == _COUNT
    assert error.rmse_m < 0.02
    assert found.mesh is not None
    last = frames[-1]
    near = np.where(last.depth_m() < 2.5, last.depth_m(), 0)
    points = world_points(near, last.camera, found.trajectory.T_world_cam[-1])
    assert np.median(distances(points, found.mesh.vertices, found.mesh.faces)) < 0.01


def test_no_frame_is_told():
    with pytest.raises(UserError, match="no readable frame"):
        frame_to_model([])
