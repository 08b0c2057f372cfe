"""Trajectories from the pose log; those of a map epoch in pieces, as a day has millions of poses."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.pose_log import DEAD_RECKONED, LOST, POSE_ROW, PoseLog
from hsslam_node.odometry.spread_errors import spread_errors


class FragmentRows(NamedTuple):
    """Number of frames of a fragment, and the numbers of the rows from its first to its last."""

    frames: int
    rows: range


class EpochPoses:
    """The poses of one map epoch up to now. Trajectories come in pieces, which are read on demand."""

    def __init__(self, log: PoseLog, map_epoch: int) -> None:
        self._log = log
        self._rows = log.rows_of_epoch(map_epoch)

    def __len__(self) -> int:
        """Number of frames, lost ones included."""
        return len(self._rows)

    def joined(self) -> Iterator[np.ndarray]:
        """The rows in pieces, [n] of POSE_ROW; those of joined fragments are tracked in the map."""
        return map(self._log.joined, self._log.slabs(self._rows))

    def online(self) -> Iterator[Trajectory]:
        """As `online_trajectory` of all rows."""
        return map(online_trajectory, self._log.slabs(self._rows))

    def final(self, T_world_keyframe: np.ndarray) -> Iterator[Trajectory]:
        """As `final_trajectory` of all rows; a piece ends before an aligned frame, as a stretch of
        dead-reckoned frames is fitted as a whole."""
        waiting = np.zeros(0, POSE_ROW)
        for rows in self.joined():
            waiting = np.concatenate([waiting, _with_pose(rows)])
            aligned = np.flatnonzero(waiting["status"] != DEAD_RECKONED)
            if len(aligned):
                end = int(aligned[-1])  # the next piece begins with it
                piece = final_trajectory(waiting[: end + 1], T_world_keyframe)
                yield Trajectory(piece.stamps_ns[:end], piece.T_world_cam[:end])
                waiting = waiting[end:].copy()
        yield final_trajectory(waiting, T_world_keyframe)

    def fragments(self) -> dict[int, FragmentRows]:
        """The rows of each fragment, joined or not, by its number."""
        found: dict[int, FragmentRows] = {}
        start = self._rows.start
        for rows in self._log.slabs(self._rows):
            for number in np.unique(rows["fragment"][rows["fragment"] > 0]).tolist():
                of_it = (start + np.flatnonzero(rows["fragment"] == number)).tolist()
                before = found.get(number, FragmentRows(0, range(of_it[0], of_it[0])))
                both = range(before.rows.start, of_it[-1] + 1)
                found[number] = FragmentRows(before.frames + len(of_it), both)
            start += len(rows)
        return dict(sorted(found.items()))

    def fragment(self, number: int, place: FragmentRows) -> Iterator[Trajectory]:
        """As `fragment_trajectory` of all rows; `place`: the rows of this fragment."""
        for rows in self._log.slabs(place.rows):
            yield fragment_trajectory(rows, number)


def online_trajectory(rows: np.ndarray) -> Trajectory:
    """The poses as published at the time; lost frames have none."""
    return _as_published(rows, rows["status"] != LOST)


def final_trajectory(rows: np.ndarray, T_world_keyframe: np.ndarray) -> Trajectory:
    """Each pose moved with its keyframe, by the poses T_world_keyframe [n, 4, 4]; lost frames have none.

    Dead-reckoned poses are fitted between the aligned frames before and after them.
    """
    kept = _with_pose(rows)
    poses = kept["T_world_cam"].copy()
    has_reference = (kept["keyframe"] >= 0) & (kept["keyframe"] < len(T_world_keyframe))
    reference = T_world_keyframe[kept["keyframe"][has_reference]]
    poses[has_reference] = reference @ kept["T_keyframe_cam"][has_reference]
    is_dead_reckoned, is_unknown = kept["status"] == DEAD_RECKONED, kept["odometry_stands"] == 1
    poses = spread_errors(poses, kept["T_odom_cam"], is_dead_reckoned, is_unknown)
    return Trajectory(kept["source_stamp_ns"].copy(), poses)


def fragment_trajectory(rows: np.ndarray, fragment: int) -> Trajectory:
    """The poses of a fragment, in a coordinate frame of its own."""
    return _as_published(rows, rows["fragment"] == fragment)


def _as_published(rows: np.ndarray, mask: np.ndarray) -> Trajectory:
    return Trajectory(rows["source_stamp_ns"][mask], rows["T_world_cam"][mask])


def _with_pose(rows: np.ndarray) -> np.ndarray:
    """The rows without lost frames; the same array if none is lost, as the rows of an hour are 80 MB."""
    mask = rows["status"] != LOST
    return rows if mask.all() else rows[mask]
