"""Reads the poses of a log, as published and as corrected by bundle adjustment."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.odometry.spread_errors import spread_errors
from hsslam_proto import messages
from hsslam_proto.pose_codec import in_joined_keyframe, pose_matrix
from hsslam_proto.topics import CORRECTION, KEYFRAME, POSE
from hsslam_services.log.reading.reader import bus_messages


@dataclass(frozen=True)
class LoggedPoses:
    """The poses of one map epoch, each frame once; lost frames are in `poses` only.

    `final`: `online` corrected with the reference keyframes, and the frames of fragments that joined the
    map, as in trajectory.txt of a run. If the log lacks the keyframe of a pose, as after a cut, the pose
    stays as published. `keyframes`: of the run, without those of a loaded map. `fragments`: poses of
    fragments that did not join, by number, as published, each in its own coordinate frame.
    """

    poses: list[messages.Pose]
    online: Trajectory
    final: Trajectory
    keyframes: Trajectory
    fragments: dict[int, Trajectory]


def logged_poses(files: list[Path]) -> LoggedPoses:
    """The poses of the last map epoch, from the files of one log, in order.

    Raises:
        UserError: a file is damaged, or of an unsupported version.
    """
    epochs = logged_epochs(files)
    return epochs[max(epochs)]


def logged_epochs(files: list[Path]) -> dict[int, LoggedPoses]:
    """The poses of all map epochs of one log, by epoch."""
    epochs: dict[int, _Found] = {}
    for logged in bus_messages(files, {POSE.name, KEYFRAME.name, CORRECTION.name}):
        match logged.message():
            case messages.Pose() as pose:
                epochs.setdefault(pose.map_epoch, _Found()).add_pose(pose)
            case messages.Keyframe() as keyframe:
                epochs.setdefault(keyframe.map_epoch, _Found()).add_keyframe(keyframe)
            case messages.Correction() as moved:
                epochs.setdefault(moved.map_epoch, _Found()).correct(moved)
    return {map_epoch: found.all() for map_epoch, found in sorted(epochs.items())} or {
        0: _Found().all()
    }


Name = tuple[int, int]  # publisher and index of a frame


@dataclass
class _Found:
    """The messages read so far; keyframe poses are the newest."""

    poses: dict[Name, messages.Pose] = field(default_factory=dict)
    T_keyframe_cam: dict[Name, np.ndarray] = field(default_factory=dict)
    waiting: dict[int, list[messages.Pose]] = field(default_factory=dict)  # by keyframe
    keyframes: dict[int, np.ndarray] = field(default_factory=dict)  # T_world_keyframe [4, 4] by id
    stamps_ns: dict[int, int] = field(default_factory=dict)  # of keyframes of the run, by id
    # keyframes of fragments that joined, by fragment and number in it
    brought: dict[int, dict[int, messages.Keyframe]] = field(default_factory=dict)

    def add_pose(self, pose: messages.Pose) -> None:
        if _name(pose) in self.poses:
            return  # the frame was sent again
        self.poses[_name(pose)] = pose
        if pose.status == "lost":
            return
        if pose.in_keyframe:
            self.T_keyframe_cam[_name(pose)] = pose_matrix(pose.in_keyframe)
        elif pose.keyframe in self.keyframes:
            self._refer(pose)
        elif pose.keyframe >= 0:
            self.waiting.setdefault(pose.keyframe, []).append(pose)

    def add_keyframe(self, keyframe: messages.Keyframe) -> None:
        # a correction of it, from another process, may have come before
        self.keyframes.setdefault(keyframe.id, pose_matrix([*keyframe.t, *keyframe.q]))
        self.stamps_ns[keyframe.id] = keyframe.source_stamp_ns
        if keyframe.fragment and keyframe.fragment_keyframe >= 0:  # -1 in older logs
            of_fragment = self.brought.setdefault(keyframe.fragment, {})
            of_fragment[keyframe.fragment_keyframe] = keyframe
        for pose in self.waiting.pop(keyframe.id, []):
            self._refer(pose)

    def correct(self, moved: messages.Correction) -> None:
        for k, t, q in zip(moved.keyframes, moved.t, moved.q, strict=True):
            self.keyframes[k] = pose_matrix([*t, *q])

    def all(self) -> LoggedPoses:
        poses = list(self.poses.values())
        known = [pose for pose in poses if pose.status != "lost"]
        placed = [pose for pose in poses if pose.status != "lost" or pose.fragment in self.brought]
        final = _trajectory(
            [pose.source_stamp_ns for pose in placed], [self._carried(pose) for pose in placed]
        )
        ids = sorted(self.stamps_ns)
        apart = {pose.fragment for pose in poses} - {0} - self.brought.keys()
        return LoggedPoses(
            poses=poses,
            online=_as_published(known),
            final=_fitted_in(final, placed),
            keyframes=_trajectory(
                [self.stamps_ns[k] for k in ids], [self.keyframes[k] for k in ids]
            ),
            fragments={
                number: _as_published([pose for pose in poses if pose.fragment == number])
                for number in sorted(apart)
            },
        )

    def _refer(self, pose: messages.Pose) -> None:
        T_keyframe_world = inverse(self.keyframes[pose.keyframe])
        self.T_keyframe_cam[_name(pose)] = T_keyframe_world @ pose_matrix([*pose.t, *pose.q])

    def _carried(self, pose: messages.Pose) -> np.ndarray:
        if pose.fragment in self.brought:
            k, T_keyframe_cam = in_joined_keyframe(pose, self.brought[pose.fragment])
            return self.keyframes[k] @ T_keyframe_cam
        T_world_keyframe = self.keyframes.get(pose.keyframe)
        T_keyframe_cam = self.T_keyframe_cam.get(_name(pose))
        if T_world_keyframe is None or T_keyframe_cam is None:
            return pose_matrix([*pose.t, *pose.q])
        return T_world_keyframe @ T_keyframe_cam


def _fitted_in(final: Trajectory, poses: list[messages.Pose]) -> Trajectory:
    """Correct the dead-reckoned poses, as `final_trajectory` of the pose log does."""
    is_dead_reckoned = np.array([pose.is_dead_reckoned for pose in poses], bool)
    if not is_dead_reckoned.any():
        return final
    path = [pose_matrix(pose.odometry) for pose in poses]
    is_unknown = np.array([pose.odometry_stands for pose in poses], bool)
    fitted = spread_errors(final.T_world_cam, np.stack(path), is_dead_reckoned, is_unknown)
    return Trajectory(final.stamps_ns, fitted)


def _name(pose: messages.Pose) -> Name:
    return pose.publisher, pose.index


def _as_published(poses: list[messages.Pose]) -> Trajectory:
    stamps_ns = [pose.source_stamp_ns for pose in poses]
    return _trajectory(stamps_ns, [pose_matrix([*pose.t, *pose.q]) for pose in poses])


def _trajectory(stamps_ns: list[int], poses: list[np.ndarray]) -> Trajectory:
    return Trajectory(np.array(stamps_ns, np.int64), np.array(poses).reshape(-1, 4, 4))
