"""Requests for the newest mesh and for the trajectory so far."""

from pathlib import Path

import numpy as np

from hsslam_node.geometry.se3 import transform
from hsslam_node.geometry.se3_batch import quaternions_from_rotations
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.pose_log import PoseLog, final_trajectory, of_map_epoch
from hsslam_node.map.store import KeyframeStore
from hsslam_proto import topics
from hsslam_proto.mesh.assembled import AssembledMesh
from hsslam_proto.mesh.codec import mesh_message
from hsslam_proto.request_messages import TrajectoryRows
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.requests.waiting_requests import WaitingRequests


class NewestMesh:
    """Answers with the mesh as the mesher has it; asking and joining is work for a thread of its own."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._map_epoch = 0
        self._waiting = WaitingRequests("meshes", self._answer)

    def ask(self, asked: PendingRequest) -> None:
        """Answer as soon as the mesher has; refused if many wait already."""
        self._waiting.add(asked)

    def forget(self, map_epoch: int) -> None:
        """The map was thrown away: answer with meshes of the next map epoch only."""
        self._map_epoch = map_epoch

    def _answer(self, asked: PendingRequest) -> None:
        live = AssembledMesh()
        for message in self._bus.state(topics.MESH_BLOCKS):
            live.add(message)
        whole = live.whole() if live.map_epoch >= self._map_epoch else None
        if whole is None:
            asked.refuse("not_now", "mesh: there is none yet: expected keyframes first")
            return
        asked.answer(mesh_message(*whole, live.map_version, map_epoch=live.map_epoch))


def trajectory_so_far(arena_dir: Path, map_epoch: int = 0) -> Trajectory | None:
    """All poses of a map epoch but those of lost frames, as refined; None before there is one."""
    arrays = ArenaView(arena_dir)
    try:
        keyframe_poses = KeyframeStore(arrays).poses()
        log = PoseLog(arrays)
        return final_trajectory(log.joined(of_map_epoch(log.rows(), map_epoch)), keyframe_poses)
    except KeyError:
        return None


def rows_of(trajectory: Trajectory, map_epoch: int = 0) -> TrajectoryRows:
    """The trajectory as a message."""
    poses = np.empty((len(trajectory), 7), "<f8")
    poses[:, :3] = trajectory.positions
    poses[:, 3:] = quaternions_from_rotations(trajectory.T_world_cam[:, :3, :3])
    return TrajectoryRows(
        count=len(trajectory),
        stamps_ns=trajectory.stamps_ns.astype("<i8").tobytes(),  # type: ignore[arg-type]
        poses=poses.tobytes(),  # type: ignore[arg-type]
        map_epoch=map_epoch,
    )


def trajectory_of(rows: TrajectoryRows) -> Trajectory:
    """The trajectory in a message."""
    poses = np.frombuffer(rows.poses, "<f8").reshape(-1, 7)
    T_world_cam = [transform(row[:3], row[3:]) for row in poses]
    stamps_ns = np.frombuffer(rows.stamps_ns, "<i8").astype(np.int64)
    return Trajectory(stamps_ns, np.array(T_world_cam).reshape(-1, 4, 4))
