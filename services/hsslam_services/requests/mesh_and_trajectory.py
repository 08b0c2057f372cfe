"""Requests for the newest mesh and for the trajectory so far."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from hsslam_node.geometry.se3_batch import quaternions_from_rotations, transforms
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.epoch_poses import EpochPoses
from hsslam_node.map.pose_log import PoseLog
from hsslam_node.map.store import KeyframeStore
from hsslam_proto import topics
from hsslam_proto.mesh.assembled import AssembledMesh
from hsslam_proto.mesh.codec import mesh_message
from hsslam_proto.request_messages import Refusal, TrajectoryRows
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.kept_messages import IncompleteStateError
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.requests.waiting_requests import WaitingRequests

MOST_POSES = 4_000_000  # 37 hours at 30 Hz; 64 bytes each of the 256 MiB that an answer may have


class NewestMesh:
    """Answers with the newest mesh; a thread fetches the mesher's blocks and merges them."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._map_epoch = 0
        self._waiting = WaitingRequests("meshes", self._answer)

    def ask(self, asked: PendingRequest) -> None:
        """Answer when the mesher has; refused if too many requests wait."""
        self._waiting.add(asked)

    def forget(self, map_epoch: int) -> None:
        """Answer only with meshes of this map epoch or later: the map was reset."""
        self._map_epoch = map_epoch

    def _answer(self, asked: PendingRequest) -> None:
        live = AssembledMesh()
        try:
            for message in self._bus.state(topics.MESH_BLOCKS):
                live.add(message)
        except IncompleteStateError:
            asked.refuse("unfinished", "mesh: the mesher did not send all of it in time: ask again")
            return
        whole = live.whole() if live.map_epoch >= self._map_epoch else None
        if whole is None:
            text = "mesh: there is no live mesh: expected keyframes, and a run that goes on"
            asked.refuse("not_now", text)
            return
        asked.answer_here(mesh_message(*whole, live.map_version, map_epoch=live.map_epoch))


class TrajectorySoFar:
    """Answers with all refined poses so far; a thread computes them. `report(text)` takes a line about poses
    that the disk does not give."""

    def __init__(self, arena_dir: Path, report: Callable[[str], None]) -> None:
        self._arena_dir = arena_dir
        self._report = report
        self._map_state = MapState(arena_dir)
        self._waiting = WaitingRequests("trajectories", self._answer)

    def ask(self, asked: PendingRequest) -> None:
        """Answer soon; refused if too many requests wait."""
        self._waiting.add(asked)

    def _answer(self, asked: PendingRequest) -> None:
        found = trajectory_so_far(self._arena_dir, self._map_state.map_epoch, report=self._report)
        if isinstance(found, Refusal):
            asked.refuse(found.reason, found.text)
        else:
            asked.answer_here(found)


def trajectory_so_far(
    arena_dir: Path,
    map_epoch: int = 0,
    most: int = MOST_POSES,
    report: Callable[[str], None] = lambda _: None,
) -> TrajectoryRows | Refusal:
    """All refined poses of a map epoch, without lost frames; a refusal if there is no pose or there may be
    more than `most`. `report(text)` is called if the disk does not give some of them."""
    arrays = ArenaView(arena_dir)
    try:
        T_world_keyframe = KeyframeStore(arrays).poses()
        log = PoseLog(arrays)
        poses = EpochPoses(log, map_epoch)
    except KeyError:
        return Refusal(reason="not_now", text="trajectory: there is no pose yet")
    if len(poses) > most:
        refused = f"trajectory: {len(poses)} frames: expected at most {most} in an answer"
        instead = "trajectory.txt has them after the run, hsslam-log export those of finished parts"
        return Refusal(reason="size", text=f"{refused}; {instead}")
    stamps_ns, numbers = np.empty(len(poses), "<i8"), np.empty((len(poses), 7), "<f8")
    count = 0
    for piece in poses.final(T_world_keyframe):
        rows = slice(count, count + len(piece))
        stamps_ns[rows], numbers[rows, :3] = piece.stamps_ns, piece.positions
        numbers[rows, 3:] = quaternions_from_rotations(piece.T_world_cam[:, :3, :3])
        count += len(piece)
    if log.unreadable:
        report(f"trajectory: {log.unreadable}")
    return TrajectoryRows(
        count=count,
        stamps_ns=stamps_ns[:count].data,
        poses=numbers[:count].data,
        map_epoch=map_epoch,
    )


def trajectory_of(rows: TrajectoryRows) -> Trajectory:
    """The trajectory in a message."""
    poses = np.frombuffer(rows.poses, "<f8").reshape(-1, 7)
    stamps_ns = np.frombuffer(rows.stamps_ns, "<i8").astype(np.int64)
    return Trajectory(stamps_ns, transforms(poses[:, :3], poses[:, 3:]))
