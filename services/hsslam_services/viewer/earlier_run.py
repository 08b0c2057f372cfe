"""What a viewer shows of the run so far, read from the arena, for the scene of a restarted recorder."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from hsslam_node.map.epoch_poses import EpochPoses
from hsslam_node.map.pose_log import LOST, POSE_ROW, PoseLog
from hsslam_node.map.store import KeyframeStore
from hsslam_proto.message import Quaternion, Vector
from hsslam_proto.pose_codec import wire_pose
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.arena.map_state import MapState
from hsslam_services.viewer.path.line import PathPose, quality_color

_STEP = 8  # from one drawn pose to the next, as in the old part of a path
_MOST_KEYFRAMES = 2048  # the newest, as many as a scene draws


class EarlierRun(NamedTuple):
    """Keyframes and path of a map epoch at their present poses."""

    map_epoch: int
    index: int  # of the newest frame of the path
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
        rows = _drawn_rows(EpochPoses(PoseLog(arrays), epoch), newest_left_out)
    except (KeyError, ValueError):  # there is no map yet, or a reset has just removed it
        return None
    if len(rows) == 0 or state.map_epoch != epoch:
        return None
    first = max(len(T_world_keyframe) - _MOST_KEYFRAMES, 0)
    newest = enumerate(T_world_keyframe[first:], first)
    return EarlierRun(
        epoch,
        int(rows[-1]["index"]),
        int(rows[-1]["stamp_ns"]),
        [(k, wire_pose(T)) for k, T in newest],
        _lines(rows, T_world_keyframe),
    )


def _drawn_rows(poses: EpochPoses, newest_left_out: int) -> np.ndarray:
    """One in `_STEP` rows, [n] of POSE_ROW, and each lost one, as it parts the path."""
    pieces, left, number = [], len(poses) - newest_left_out, 0
    for rows in poses.joined():
        rows = rows[: max(left - number, 0)]
        numbers = np.arange(number, number + len(rows))
        pieces.append(rows[(numbers % _STEP == 0) | (rows["status"] == LOST)])
        number += len(rows)
    return np.concatenate(pieces) if pieces else np.zeros(0, POSE_ROW)


def _lines(rows: np.ndarray, T_world_keyframe: np.ndarray) -> list[list[PathPose]]:
    """The parts of the path between lost rows."""
    has_place = (rows["status"] != LOST) & (rows["keyframe"] >= 0)
    has_place &= rows["keyframe"] < len(T_world_keyframe)
    inside = rows["T_keyframe_cam"][:, :3, 3]
    T = T_world_keyframe[np.where(has_place, rows["keyframe"], 0)]
    at = np.einsum("nij,nj->ni", T[:, :3, :3], inside) + T[:, :3, 3]
    parts = np.split(np.arange(len(rows)), np.flatnonzero(~has_place))
    return [
        [
            PathPose(
                tuple(at[n].tolist()),
                quality_color(float(rows["quality"][n])),
                int(rows["keyframe"][n]),
                tuple(inside[n].tolist()),
            )
            for n in part[has_place[part]].tolist()
        ]
        for part in parts
        if np.count_nonzero(has_place[part]) > 1
    ]
