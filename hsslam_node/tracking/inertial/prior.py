"""Predicts rotations since the last aligned frame by the IMU, and measures gravity for the store."""

import numpy as np

from hsslam_node.geometry.se3 import so3_log
from hsslam_node.inertial.gravity import GravityFit, GravityWindows
from hsslam_node.inertial.gyro_bias import GyroBias
from hsslam_node.inertial.reading import ImuReading, motion_between
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.motion_agreement import MotionAgreement
from hsslam_node.tracking.tracked_frame import JoinedFragment

_REST_RAD_S = 0.06  # by which the IMU may differ, also at rest: bias, and noise of tracking
_SURE_WINDOWS = 5  # of about a second, before gravity is called wrong
_DOWN = -0.5  # cosine to the usual up: cameras that look down or up have about 0


class InertialPrior:
    """Learns gyroscope bias and gravity from aligned frames, and gives predictions the IMU's rotation.

    An IMU that rotates unlike the camera is not used.

    Args:
        turns_predictions: False leaves predictions as they are; gravity is still learnt.
    """

    def __init__(self, store: KeyframeStore, turns_predictions: bool) -> None:
        self._store = store
        self._turns_predictions = turns_predictions
        self._bias = GyroBias()
        self._windows = GravityWindows()
        self._agreement = MotionAgreement(_REST_RAD_S)
        self._last: ImuReading | None = None  # of the last aligned frame
        self._newest: ImuReading | None = None
        self._turn: np.ndarray | None = None  # [3, 3] newest frame with a reading to last aligned
        self._has_noted = False  # whether it has written gravity to the store
        # m/s^2, mean acceleration that is not gravity, negative: downwards; None: it is, or is not known
        self.implausible_gravity: float | None = None
        self._is_current = False  # whether the frame that is tracked now has a reading

    @property
    def disagrees(self) -> bool:
        """Whether the IMU rotates unlike the camera."""
        return self._agreement.is_known and not self._agreement.holds

    def take(self, reading: ImuReading | None) -> None:
        """Take the reading of the frame that is tracked next; may be called twice for a frame."""
        self._is_current = reading is not None
        if reading is None:
            return
        motion = motion_between(self._newest, reading)
        if motion is None:
            self._turn = None
        elif self._turn is not None:
            self._turn = self._turn @ self._bias.removed(motion)
        self._newest = reading

    def turned(self, T_world_cam: np.ndarray, T_world_last: np.ndarray) -> np.ndarray:
        """A predicted pose [4, 4] with the IMU's rotation since the last aligned frame, if that is known."""
        if self._turn is None or not (self._is_current and self._turns_predictions):
            return T_world_cam
        if not (self._agreement.is_known and self._agreement.holds):
            return T_world_cam
        out = T_world_cam.copy()
        out[:3, :3] = T_world_last[:3, :3] @ self._turn
        return out

    def aligned(
        self, reading: ImuReading | None, T_last_cam: np.ndarray, keyframe: int,
        T_keyframe_cam: np.ndarray,
    ) -> None:  # fmt: skip
        """Take an aligned frame: its motion [4, 4] since the last aligned one, its pose at a keyframe."""
        motion = motion_between(self._last, reading)
        if motion is not None and motion.seconds > 0:
            R = T_last_cam[:3, :3]
            R_off = self._bias.removed(motion).T @ R
            self._agreement.compare(_angle_rad(R), _angle_rad(R_off), motion.seconds)
            self._bias.learn(motion, R)
            is_full = self._windows.add(motion, T_last_cam, keyframe, T_keyframe_cam[:3, :3])
            if is_full and not self.disagrees:
                self._learn_gravity()
        else:
            self._windows.break_off()
        self._begin(reading)

    def restart(self, reading: ImuReading | None) -> None:
        """Measure rotations from this frame on; the motion before it is not known."""
        self._windows.break_off()
        self._begin(reading)

    def take_over(self, other: "InertialPrior", joined: JoinedFragment) -> None:
        """Continue from a fragment that has joined the store: rotations and bias are in the axes of the
        camera, and each window of gravity in those of a keyframe."""
        self._bias.take_over(other._bias)
        self._windows.take_over(other._windows, joined.keyframes, joined.T_keyframe_own[:, :3, :3])
        if other._agreement.is_known:
            self._agreement = other._agreement
        self._last, self._newest, self._turn = other._last, other._newest, other._turn

    def _begin(self, reading: ImuReading | None) -> None:
        self._last = self._newest = reading
        self._turn = None if reading is None else np.eye(3)

    def _learn_gravity(self) -> None:
        R_world_keyframe = self._store.poses_of(self._windows.keyframes)[:, :3, :3]
        fit = self._windows.fit(R_world_keyframe)
        if fit is None:
            return
        is_down = fit.is_plausible and self._points_down(fit, R_world_keyframe)
        is_wrong = (is_down or not fit.is_plausible) and len(self._windows) >= _SURE_WINDOWS
        length = float(np.linalg.norm(fit.up))
        self.implausible_gravity = (-length if is_down else length) if is_wrong else None
        gravity = fit.gravity
        if gravity is None or is_down:
            return
        known = self._store.world_frame.gravity
        if self._has_noted or known is None or gravity.sigma_rad < known.sigma_rad:
            self._store.world_frame.note_gravity(gravity)
            self._has_noted = True

    def _points_down(self, fit: GravityFit, R_world_keyframe: np.ndarray) -> bool:
        """Whether measured up is down by the level frame, or if that is not known, in the images of the
        keyframes [n, 3, 3]: accelerations have the other sign, or the camera hangs upside down."""
        T_level_world = self._store.world_frame.T_level_world
        up = (
            -R_world_keyframe[:, :, 1].mean(axis=0)
            if T_level_world is None
            else T_level_world[2, :3]
        )
        return bool(up @ fit.up < _DOWN * np.linalg.norm(fit.up))


def _angle_rad(R: np.ndarray) -> np.ndarray:
    """Angle of a rotation [3, 3], [1] rad."""
    return np.array([np.linalg.norm(so3_log(R))])
