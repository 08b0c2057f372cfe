"""The camera's path without jumps, as in `odom` of ROS: without corrections of the map."""

from collections import deque
from dataclasses import replace

import numpy as np

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.pose_log import INITIAL, LOST, PoseLog
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.tracked_frame import orthonormal

_FRAMES = 10  # newest ones; they give the usual time between frames
_GAP = 1.5  # times the usual time between frames


class SmoothPath:
    """Adds up the motions between frames, each from the newest poses of their keyframes.

    The path stands still between two frames if no motion is known: they are further apart than
    `longest_gap_s` and 1.5 times the usual time, are of two map epochs, or the tracker has not followed
    the camera between them. A restarted tracker continues the path.

    In a fragment the path goes on by the motions there. It stands still where the fragment begins, and where
    the camera comes back to the map.

    Args:
        robot: if given, a path that stands still, or begins in a saved map, takes the height and tilt that
            the robot has in `map`.
    """

    def __init__(
        self, log: PoseLog, longest_gap_s: float, robot: RobotFrames | None = None
    ) -> None:
        self._robot = robot
        self._longest_gap_ns = round(1e9 * longest_gap_s)
        newest = range(max(log.count - _FRAMES, 0), log.count)
        stamps_ns = [t for rows in log.slabs(newest) for t in rows["source_stamp_ns"].tolist()]
        self._stamps_ns = deque(stamps_ns, _FRAMES)
        self._last = _newest_with_pose(log)
        self._T_odom_cam = _newest_odometry(log)
        self._last_of_fragment: np.ndarray | None = None

    def add(
        self,
        row: np.ndarray,
        store: KeyframeStore | None,
        T_expected: np.ndarray | None = None,
        *,
        is_carried: bool = False,
    ) -> None:
        """Fill in `T_odom_cam` (of a lost frame: the last one) and `odometry_stands` of a row of the log.

        T_expected: [4, 4] camera to world by the robot's odometry, of the first aligned frame after frames
        with poses by odometry alone; the path leaves out the error of the odometry.
        is_carried: the tracker does not know the motion since the last frame with a pose.
        """
        self._stamps_ns.append(int(row["source_stamp_ns"]))
        if row["fragment"]:
            self._add_of_fragment(row, T_expected, is_carried=is_carried)
            return
        row["odometry_stands"] = True
        if row["status"] != LOST and store is not None:
            if not is_carried and self._is_motion(self._last, row):
                row["odometry_stands"] = False
                motion = self._motion(row, store, T_expected)
                self._T_odom_cam = orthonormal(self._T_odom_cam @ motion)
            elif self._last is not None or row["status"] != INITIAL:
                self._T_odom_cam = self._on_level(row["T_world_cam"], store)
            self._last = row.copy()
        row["T_odom_cam"] = self._T_odom_cam

    def _add_of_fragment(
        self, row: np.ndarray, T_expected: np.ndarray | None, *, is_carried: bool
    ) -> None:
        """Fill in a row of a fragment. Nothing corrects poses there, so those of the rows give the motion."""
        last, stands = self._last_of_fragment, True
        if last is not None and last["fragment"] == row["fragment"] and not is_carried:
            stands = not self._is_motion(last, row)
            if not stands:
                T = row["T_world_cam"] if T_expected is None else T_expected
                self._T_odom_cam = orthonormal(self._T_odom_cam @ inverse(last["T_world_cam"]) @ T)
        row["T_odom_cam"], row["odometry_stands"] = self._T_odom_cam, stands
        self._last_of_fragment = row.copy()
        self._last = None  # the motion since that frame of the map is in the path already

    def _is_motion(self, last: np.ndarray | None, row: np.ndarray) -> bool:
        if last is None or last["map_epoch"] != row["map_epoch"]:
            return False
        gap_ns = int(row["source_stamp_ns"]) - int(last["source_stamp_ns"])
        if gap_ns <= self._longest_gap_ns:
            return gap_ns > 0
        return gap_ns <= _GAP * float(np.median(np.diff(self._stamps_ns)))

    def _on_level(self, T_world_cam: np.ndarray, store: KeyframeStore) -> np.ndarray:
        """The path at a pose [4, 4] after an unknown motion."""
        T_level_world = store.world_frame.T_level_world
        if self._robot is None or T_level_world is None:
            return self._T_odom_cam
        robot = replace(self._robot, T_level_world=T_level_world)
        return orthonormal(robot.on_level(self._T_odom_cam, T_world_cam))

    def _motion(
        self, row: np.ndarray, store: KeyframeStore, T_expected: np.ndarray | None
    ) -> np.ndarray:
        """T_last_cam [4, 4], from the newest poses of the keyframes."""
        assert self._last is not None
        T_world_key = store.poses_of(np.array([self._last["keyframe"], row["keyframe"]]))
        T_last, T = T_world_key @ np.stack([self._last["T_keyframe_cam"], row["T_keyframe_cam"]])
        return inverse(T_last) @ (T if T_expected is None else T_expected)


def _newest_odometry(log: PoseLog) -> np.ndarray:
    """The path at the newest row of any frame, [4, 4]; the identity if there is none."""
    for rows in log.slabs(newest_first=True):
        if len(rows):
            return rows[-1]["T_odom_cam"].copy()
    return np.eye(4)


def _newest_with_pose(log: PoseLog) -> np.ndarray | None:
    """A copy of the newest row of a frame that is not lost; None if there is none."""
    for rows in log.slabs(newest_first=True):
        with_pose = np.flatnonzero(rows["status"] != LOST)
        if len(with_pose):
            return rows[with_pose[-1]].copy()
    return None
