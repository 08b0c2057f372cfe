"""Predicts the pose of the next frame from the last two aligned frames and the IMU."""

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.inertial.prior import InertialPrior
from hsslam_node.tracking.tracked_frame import (
    LONGEST_EXTRAPOLATION,
    JoinedFragment,
    TrackedFrame,
    is_foreseen,
    predicted_pose,
)

_SAME_ROOM_S = 1.5  # in this time a camera does not go from a room to one that looks alike


class CameraMotion:
    """Keeps the last two aligned frames and predicts the pose of the next one, by constant velocity.

    If frames carry IMU readings, these predict the rotation and measure gravity for the store. After a lost
    frame the velocity is unknown, as the camera may have been carried.
    """

    def __init__(self, config: TrackerConfig, store: KeyframeStore) -> None:
        self._store = store
        self._longest_gap_s = config.longest_gap_s
        self._inertial = InertialPrior(store, config.inertial_rotation)
        self._last: TrackedFrame | None = None
        self._before_last: TrackedFrame | None = None
        # the frame that the motion began with, if all frames since then were aligned
        self._begun: TrackedFrame | None = None
        self.lost_frames = 0  # since the last aligned one

    @property
    def has_begun(self) -> bool:
        """Whether a frame was aligned, or began the map."""
        return self._last is not None

    @property
    def last(self) -> TrackedFrame:
        """The last aligned frame; only if `has_begun`."""
        assert self._last is not None
        return self._last

    @property
    def T_world_last(self) -> np.ndarray:
        """Pose [4, 4] of the last aligned frame, by the current pose of its keyframe."""
        return self.last.pose(self._store)

    @property
    def is_known(self) -> bool:
        """Whether there are two aligned frames, which give a velocity."""
        return self._before_last is not None

    @property
    def imu_disagrees(self) -> bool:
        """Whether the IMU rotates unlike the camera, so that it is not used."""
        return self._inertial.disagrees

    @property
    def implausible_gravity(self) -> float | None:
        """Mean acceleration of the IMU in m/s^2 (negative: downwards), if it is not gravity; None: it is, or
        is not known."""
        return self._inertial.implausible_gravity

    def take(self, frame: Frame) -> None:
        """Take the IMU reading of the frame that is aligned next; may be called twice for a frame."""
        self._inertial.take(frame.imu)

    def predicted(self, stamp_ns: int, longest: float = LONGEST_EXTRAPOLATION) -> np.ndarray:
        """T_world_cam [4, 4] at stamp_ns; `longest` as for `predicted_pose`."""
        T = predicted_pose(self.last, self._before_last, self._store, stamp_ns, longest)
        return self._inertial.turned(T, self.T_world_last)

    def is_foreseen(self, stamp_ns: int) -> bool:
        """Whether the prediction is reliable: the camera is not lost, and there was no gap."""
        if self.last is self._begun:  # no velocity yet
            return not self.is_after_gap(stamp_ns)
        return self.lost_frames == 0 and is_foreseen(self.last, self._before_last, stamp_ns)

    def is_after_gap(self, stamp_ns: int) -> bool:
        """Whether the camera is lost, or the last aligned frame is too old."""
        return self._was_away(stamp_ns, self._longest_gap_s)

    def may_be_elsewhere(self, stamp_ns: int) -> bool:
        """Whether the camera may have gone to another room: it is lost, or was last aligned long ago."""
        return self._was_away(stamp_ns, _SAME_ROOM_S)

    def _was_away(self, stamp_ns: int, longest_s: float) -> bool:
        gap_s = 1e-9 * (stamp_ns - self.last.frame.stamp_ns)
        return self.lost_frames > 0 or gap_s > longest_s

    def begin(self, frame: Frame, keyframe: int) -> None:
        """Continue from a frame that is a keyframe and was not aligned to another."""
        self._last, self._before_last = TrackedFrame(frame, keyframe, np.eye(4)), None
        self._begun = self._last
        self._inertial.restart(frame.imu)

    def resume(self, keyframe: int, lost_frames: int) -> None:
        """Continue from a keyframe of the store, as after `lost_frames` lost frames."""
        self._last = TrackedFrame(self._store.frame(keyframe), keyframe, np.eye(4))
        self._before_last, self.lost_frames = None, lost_frames

    def take_over(self, other: "CameraMotion", joined: JoinedFragment) -> None:
        """Continue the motion of a fragment that has joined the store."""
        self._last = joined.placed(other.last)
        self._before_last = other._before_last and joined.placed(other._before_last)
        self.lost_frames = other.lost_frames
        self._inertial.take_over(other._inertial, joined)

    def note_carried(self) -> None:
        """Drop the velocity, as a person names the place of the next frame."""
        self.lost_frames = max(self.lost_frames, 1)

    def aligned(
        self, frame: Frame, T_world_cam: np.ndarray, keyframe: int, T_keyframe_cam: np.ndarray
    ) -> None:
        """Take a frame aligned at T_world_cam [4, 4], which is T_keyframe_cam [4, 4] from a keyframe."""
        if self.lost_frames == 0:
            T_last_cam = inverse(self.T_world_last) @ T_world_cam
            self._inertial.aligned(frame.imu, T_last_cam, keyframe, T_keyframe_cam)
        else:
            self._inertial.restart(frame.imu)
        self._before_last = self._last if self.lost_frames == 0 else None
        self._last = TrackedFrame(frame, keyframe, T_keyframe_cam)
        self.lost_frames = 0

    def unaligned(self, *, is_lost: bool) -> None:
        """Take a frame that was not aligned: it is lost or dead-reckoned."""
        self._before_last = self._begun = None
        self.lost_frames += is_lost
