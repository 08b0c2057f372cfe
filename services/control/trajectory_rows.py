"""The trajectory as the wire has it, from the pose log of a running service."""

from pathlib import Path

import numpy as np

from hsslam_node.geometry.se3 import quaternion_from_rotation, transform
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.keyframes.store import KeyframeStore
from hsslam_node.proto.request_messages import TrajectoryRows
from hsslam_node.services.control.arena_view import ArenaView
from hsslam_node.tracking.pose_log import PoseLog, final_trajectory, of_world


def trajectory_so_far(arena_dir: Path, world: int = 0) -> Trajectory | None:
    """All poses in a world but those of lost frames, as refined; None before there is one."""
    arrays = ArenaView(arena_dir)
    try:
        keyframe_poses = KeyframeStore(arrays).poses()
        return final_trajectory(of_world(PoseLog(arrays).rows(), world), keyframe_poses)
    except KeyError:
        return None


def rows_of(trajectory: Trajectory, world: int = 0) -> TrajectoryRows:
    """The trajectory as a message."""
    poses = np.empty((len(trajectory), 7), "<f8")
    poses[:, :3] = trajectory.positions
    for row, T in zip(poses, trajectory.T_world_cam, strict=True):
        row[3:] = quaternion_from_rotation(T[:3, :3])
    return TrajectoryRows(
        count=len(trajectory),
        stamps_ns=trajectory.stamps_ns.astype("<i8").tobytes(),  # type: ignore[arg-type]
        poses=poses.tobytes(),  # type: ignore[arg-type]
        world=world,
    )


def trajectory_of(rows: TrajectoryRows) -> Trajectory:
    """The trajectory in a message."""
    poses = np.frombuffer(rows.poses, "<f8").reshape(-1, 7)
    T_world_cam = [transform(row[:3], row[3:]) for row in poses]
    stamps_ns = np.frombuffer(rows.stamps_ns, "<i8").astype(np.int64)
    return Trajectory(stamps_ns, np.array(T_world_cam).reshape(-1, 4, 4))
