"""What a viewer shows of the run so far, read from the arena, for the scene of a restarted recorder."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from hsslam_node.map.pose_log import LOST, POSE_ROW, PoseLog
from hsslam_node.map.store import KeyframeStore
from hsslam_proto.message import Quaternion, Vector
from hsslam_proto.pose_codec import wire_pose
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.arena.map_state import MapState
from hsslam_services.viewer.path.line import PathPose, quality_color

_STEP = 8  # from one drawn pose to the next, at least, as in the old part of a path
_MOST_POSES = 1 << 17  # the newest: 73 minutes at 30 Hz
_MOST_DRAWN = 1 << 13
_MOST_KEYFRAMES = 2048  # the newest, as many as a scene draws


class EarlierRun(NamedTuple):
    """Keyframes and path of a map epoch at their present poses."""

    map_epoch: int
    index: int  # of the newest frame, to which the former recorder may have drawn
    stamp_ns: int
    keyframes: list[tuple[int, tuple[Vector, Quaternion]]]
    lines: list[list[PathPose]]  # parts of the path; the camera was lost between them


def read_earlier_run(arena_dir: Path, newest_left_out: int) -> EarlierRun | None:
    """Read the run so far, without the newest frames, which a recorder receives itself; None: there is none.

    Raises:
        OSError: an array was moved to the disk, which does not give it.
    """
    state, arrays = MapState(arena_dir), ArenaView(arena_dir)
    epoch = state.map_epoch
    try:
        T_world_keyframe = KeyframeStore(arrays).poses()
        log = PoseLog(arrays)
        newest = log.last()
        rows, parts = _drawn_rows(log, epoch, newest_left_out)
    except (KeyError, ValueError):  # there is no map yet, or a reset has just removed it
        return None
    if newest is None or len(rows) == 0 or state.map_epoch != epoch:
        return None
    first = max(len(T_world_keyframe) - _MOST_KEYFRAMES, 0)
    placed = enumerate(T_world_keyframe[first:], first)
    return EarlierRun(
        epoch,
        int(newest["index"]),
        int(newest["stamp_ns"]),
        [(k, wire_pose(T)) for k, T in placed],
        _lines(rows, parts, T_world_keyframe),
    )


def _drawn_rows(
    log: PoseLog, map_epoch: int, newest_left_out: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rows [n] of POSE_ROW in equal steps, without lost ones, and the part of the path of each, [n] int64:
    a lost row begins the next part."""
    numbers = log.rows_of_epoch(map_epoch)
    numbers = numbers[: max(len(numbers) - newest_left_out, 0)][-_MOST_POSES:]
    step = max(_STEP, -(-len(numbers) // _MOST_DRAWN))
    drawn, parts, read, part = [np.zeros(0, POSE_ROW)], [np.zeros(0, np.int64)], 0, 0
    for rows in map(log.joined, log.slabs(numbers)):
        is_lost = rows["status"] == LOST
        chosen = np.flatnonzero(~is_lost & (np.arange(read, read + len(rows)) % step == 0))
        part_of_each = part + np.cumsum(is_lost)
        drawn.append(rows[chosen])
        parts.append(part_of_each[chosen])
        read, part = read + len(rows), part + np.count_nonzero(is_lost)
    return np.concatenate(drawn), np.concatenate(parts)


def _lines(
    rows: np.ndarray, parts: np.ndarray, T_world_keyframe: np.ndarray
) -> list[list[PathPose]]:
    """The poses of each part of the path that has two or more."""
    has_place = (rows["keyframe"] >= 0) & (rows["keyframe"] < len(T_world_keyframe))
    rows, parts = rows[has_place], parts[has_place]
    T, inside = T_world_keyframe[rows["keyframe"]], rows["T_keyframe_cam"][:, :3, 3]
    at = np.einsum("nij,nj->ni", T[:, :3, :3], inside) + T[:, :3, 3]
    poses = [
        PathPose((x, y, z), quality_color(quality), k, (u, v, w))
        for (x, y, z), quality, k, (u, v, w) in zip(
            at.tolist(), rows["quality"].tolist(), rows["keyframe"].tolist(), inside.tolist(),
            strict=True,
        )
    ]  # fmt: skip
    ends = [*(np.flatnonzero(np.diff(parts)) + 1).tolist(), len(poses)]
    lines = [poses[first:end] for first, end in zip([0, *ends], ends, strict=False)]
    return [line for line in lines if len(line) > 1]
