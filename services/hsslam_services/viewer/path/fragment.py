"""Keeps the poses of a fragment until it joins the map."""

from collections.abc import Mapping

import numpy as np

from hsslam_proto.messages import Keyframe, Pose
from hsslam_proto.pose_codec import in_joined_keyframe, pose_matrix
from hsslam_services.viewer.path.line import PathLine, PathPose, quality_color

_MOST_POSES = 1024  # a longer fragment is thinned


class FragmentPath:
    """The poses of fragment `number`, and its keyframes in the map, in any order.

    `has_news`: whether the fragment has joined the map, and has changed since the last call of `placed`.
    `stretch`: the line from the place where the camera was lost to the place where it was found.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.has_news = False
        self.stretch: PathLine | None = None
        self._poses: list[Pose] = []
        self._step, self._seen = 1, 0
        self._keyframes: dict[int, Keyframe] = {}  # by their number in the fragment
        self._T_world_keyframe: dict[int, np.ndarray] = {}  # by their id in the map

    @property
    def keyframes(self) -> set[int]:
        """Ids of the keyframes of the map that came from the fragment."""
        return set(self._T_world_keyframe)

    def add(self, pose: Pose) -> None:
        """Add a frame."""
        if self._seen % self._step == 0:
            self._poses.append(pose)
            self.has_news = bool(self._keyframes)
        self._seen += 1
        if len(self._poses) > _MOST_POSES:
            del self._poses[1::2]
            self._step *= 2

    def add_keyframe(self, keyframe: Keyframe) -> None:
        """Add a keyframe of the map from the fragment; old logs lack its number in the fragment."""
        if keyframe.fragment_keyframe < 0:
            return
        self._keyframes[keyframe.fragment_keyframe] = keyframe
        self._T_world_keyframe[keyframe.id] = pose_matrix([*keyframe.t, *keyframe.q])
        self.has_news = bool(self._poses)

    def correct(self, T_world_keyframe: Mapping[int, np.ndarray]) -> None:
        """Set the new poses [4, 4] of these keyframes."""
        for k in self._T_world_keyframe.keys() & T_world_keyframe.keys():
            self._T_world_keyframe[k] = T_world_keyframe[k]

    def end_stretch(self, stretch: PathLine) -> None:
        """Set the line to the place where the camera was found, if it is the first."""
        if self.stretch is None:
            self.stretch = stretch
            self.has_news = bool(self._keyframes and self._poses)

    def placed(self) -> list[PathPose]:
        """The poses of the fragment in the map."""
        self.has_news = False
        return [self._placed(pose) for pose in self._poses]

    def _placed(self, pose: Pose) -> PathPose:
        k, T_keyframe_cam = in_joined_keyframe(pose, self._keyframes)
        x, y, z = (self._T_world_keyframe[k] @ T_keyframe_cam)[:3, 3].tolist()
        inside = T_keyframe_cam[:3, 3].tolist()
        return PathPose((x, y, z), quality_color(pose.quality), k, tuple(inside))
