"""Requests for the newest mesh and for the trajectory so far."""

import time
from pathlib import Path

import numpy as np

from hsslam_node.geometry.se3 import transform
from hsslam_node.geometry.se3_batch import quaternions_from_rotations
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.pose_log import PoseLog, final_trajectory, of_world
from hsslam_node.map.store import KeyframeStore
from hsslam_proto import topics
from hsslam_proto.request_messages import TrajectoryRows
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.bus.subscription import Received, Subscription

_PATIENCE_S = 4.0  # for the mesher to send what it keeps


class NewestMesh:
    """Listens to meshes from the first request on; before that they cost nothing."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._meshes: Subscription | None = None
        self._newest: Received | None = None
        self._world = 0
        self._waiting: list[tuple[PendingRequest, float]] = []

    def ask(self, asked: PendingRequest) -> None:
        """Answer as soon as there is a mesh."""
        if self._meshes is None:
            self._meshes = self._bus.subscribe(topics.MESH, 1, history=True)
        self._waiting.append((asked, time.monotonic() + _PATIENCE_S))

    def forget(self, world: int) -> None:
        """The map was thrown away: answer with meshes of the next world only."""
        self._newest, self._world = None, world

    def tick(self) -> None:
        """Take in what has come, and answer; never blocks."""
        if self._meshes is None:
            return
        while (received := self._meshes.poll_received()) is not None:
            if received.message.world >= self._world:
                self._newest = received
        still: list[tuple[PendingRequest, float]] = []
        for asked, until_s in self._waiting:
            if self._newest is not None:
                asked.answer_payload(self._newest.payload)
            elif time.monotonic() > until_s:
                asked.refuse("not_now", "mesh: there is none yet: expected keyframes first")
            else:
                still.append((asked, until_s))
        self._waiting = still


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
    poses[:, 3:] = quaternions_from_rotations(trajectory.T_world_cam[:, :3, :3])
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
