"""Gravity in the map, from an accelerometer along tracked poses."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from hsslam_node.inertial.reading import InertialMotion

STANDARD_GRAVITY = 9.80665  # m/s^2
_WINDOW_S = 1.0
_BIAS = 0.3  # m/s^2, standard deviation of an accelerometer's bias: 30 mg
_SCALE = 0.1  # m/s^2, standard deviation of gravity's length: sensor scale, place on Earth
_LEAST_NOISE = 0.02  # m/s^2, of the mean of a window
_TAIL = 3.0  # standard deviations, beyond which windows lose weight
_ROUNDS = 6
_FEWEST, _MOST = 3, 1000  # windows for a fit; windows kept, the newest
_KNOWN_RAD = 0.01  # largest standard deviation of a known direction: 0.6 degrees
_PLAUSIBLE = (8.8, 10.8)  # m/s^2, length of measured gravity


@dataclass(frozen=True)
class Gravity:
    """The direction against gravity in the world of the map."""

    up: tuple[float, float, float]  # unit length
    sigma_rad: float  # standard deviation of the direction, along the worst axis

    def __post_init__(self) -> None:
        if not math.isclose(math.hypot(*self.up), 1.0, abs_tol=1e-6) or not self.sigma_rad >= 0:
            raise ValueError(f"gravity: up {self.up}, sigma {self.sigma_rad}: expected a direction")

    def turned(self, R: np.ndarray) -> "Gravity":
        """In other axes: R [3, 3] maps vectors of the old ones to the new ones."""
        x, y, z = (R @ np.array(self.up)).tolist()
        return Gravity((x, y, z), self.sigma_rad)


@dataclass(frozen=True)
class GravityFit:
    """The gravity and accelerometer bias that explain the measurements best."""

    up: np.ndarray  # [3] m/s^2, world: against gravity, with its length
    bias: np.ndarray  # [3] m/s^2, camera axes
    sigma_rad: float

    @property
    def is_plausible(self) -> bool:
        """Whether the length is that of gravity; False if accelerations exclude it or have other units."""
        return _is_plausible(self.up)

    @property
    def gravity(self) -> Gravity | None:
        """The direction; None while it is uncertain, or if the length is not plausible."""
        if not self.is_plausible or self.sigma_rad > _KNOWN_RAD:
            return None
        x, y, z = (self.up / np.linalg.norm(self.up)).tolist()
        return Gravity((x, y, z), self.sigma_rad)


class GravityWindows:
    """Mean specific forces over windows of about one second, without the camera's own acceleration.

    The mean force over a second is the sum of gravity, the sensor's bias, and the change of velocity, which
    tracked positions give. It is kept in the axes of a keyframe, whose pose may be corrected later.
    """

    def __init__(self) -> None:
        self._rows: deque[tuple[int, np.ndarray, np.ndarray]] = deque(maxlen=_MOST)
        self._open: _Window | None = None

    def __len__(self) -> int:
        return len(self._rows)

    def add(
        self, motion: InertialMotion, T_before_after: np.ndarray, keyframe: int,
        R_keyframe_cam: np.ndarray,
    ) -> bool:  # fmt: skip
        """Take the motion between two tracked frames; returns whether it completes a window.

        T_before_after: [4, 4] the same motion, tracked. R_keyframe_cam: [3, 3] of the later frame. A motion
        over a gap discards the open window.
        """
        if not motion.is_short:
            self.break_off()
            return False
        if self._open is None:
            self._open = _Window(motion, T_before_after)
            return False
        force, axes = self._open.extended(motion, T_before_after)
        if self._open.seconds < _WINDOW_S:
            return False
        self._rows.append((keyframe, R_keyframe_cam @ force, R_keyframe_cam @ axes))
        self._open = _Window(motion, T_before_after)
        return True

    def break_off(self) -> None:
        """Discard the open window: the camera was not tracked."""
        self._open = None

    def take_over(
        self, other: "GravityWindows", keyframes: np.ndarray, R_keyframe_own: np.ndarray
    ) -> None:
        """Add the windows of another map, and go on with its open window.

        Args:
            other: the windows of the other map, which has n keyframes.
            keyframes: [n] int64, the keyframe of this map with which each of its keyframes moves.
            R_keyframe_own: [n, 3, 3]; R_keyframe_own[k] maps vectors in the axes of keyframe k of the other
                map to the axes of keyframe keyframes[k] of this map.
        """
        for k, force, axes in other._rows:
            R = R_keyframe_own[k]
            self._rows.append((int(keyframes[k]), R @ force, R @ axes))
        self._open = other._open

    @property
    def keyframes(self) -> np.ndarray:
        """[n] int64, the keyframe of each window."""
        return np.array([row[0] for row in self._rows], np.int64)

    def fit(self, R_world_keyframe: np.ndarray) -> GravityFit | None:
        """The fit to all windows, with rotations [n, 3, 3] of their keyframes; None: too few windows."""
        if len(self._rows) < _FEWEST:
            return None
        force = np.stack([row[1] for row in self._rows])  # [n, 3] m/s^2, axes of keyframes
        axes = np.stack([row[2] for row in self._rows])  # [n, 3, 3] camera to keyframe, mean
        return fit_gravity(
            np.einsum("nij,nj->ni", R_world_keyframe, force), R_world_keyframe @ axes
        )


class _Window:
    """A window from the middle of one motion to that of another; axes of the camera after the newest."""

    def __init__(self, motion: InertialMotion, T_before_after: np.ndarray) -> None:
        self.seconds = 0.0
        R = T_before_after[:3, :3].T
        self._first_velocity = R @ T_before_after[:3, 3] / motion.seconds  # mean of the motion
        self._force = motion.velocity_change / 2  # since the middle of the first motion
        self._axes = np.eye(3) * (motion.seconds / 2)
        self._rest_s = motion.seconds / 2

    def extended(
        self, motion: InertialMotion, T_before_after: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean force [3] without the camera's own acceleration, up to the middle of this motion, and the mean
        of the camera's axes [3, 3]."""
        R = T_before_after[:3, :3].T  # axes before to axes after
        half_s = motion.seconds / 2
        self.seconds += self._rest_s + half_s
        self._rest_s = half_s
        self._first_velocity = R @ self._first_velocity
        force = R @ self._force + motion.velocity_change / 2
        axes = R @ self._axes + np.eye(3) * half_s
        velocity = R @ T_before_after[:3, 3] / motion.seconds
        self._force = force + motion.velocity_change / 2
        self._axes = axes + np.eye(3) * half_s
        mean = (force - (velocity - self._first_velocity)) / self.seconds
        return mean, axes / self.seconds


def fit_gravity(force: np.ndarray, axes: np.ndarray) -> GravityFit:
    """Gravity and bias by least squares: force = up + axes @ bias, outliers with less weight (Cauchy).

    The length of gravity is known to 1 %, the bias to 30 mg; rotation of the camera separates the two.

    Args:
        force: [n, 3] m/s^2, world.
        axes: [n, 3, 3] camera to world, mean over each window.
    """
    n = len(force)
    A = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), axes], axis=2)  # [n, 3, 6]
    x = np.concatenate([np.median(force, axis=0), np.zeros(3)])
    for is_length_known in (False, True):  # the known length is used if the first fit is plausible
        if is_length_known and not _is_plausible(x[:3]):
            break
        for _ in range(_ROUNDS):
            x, information = _round(force, A, x, is_length_known)
    length = float(np.linalg.norm(x[:3])) + 1e-12
    across = np.eye(3) - np.outer(x[:3], x[:3]) / length**2
    of_direction = across @ np.linalg.inv(information)[:3, :3] @ across
    sigma = math.sqrt(max(float(np.linalg.eigvalsh(of_direction)[-1]), 0.0)) / length
    return GravityFit(x[:3], x[3:], sigma)


def _round(
    force: np.ndarray, A: np.ndarray, x: np.ndarray, is_length_known: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Gravity and bias [6], weighted by the residuals at x [6], and their information [6, 6]."""
    off = np.linalg.norm(force - A @ x, axis=1) / math.sqrt(3)  # [n], of one axis
    noise = max(1.4826 * float(np.median(off)), _LEAST_NOISE)
    weight = 1 / (noise**2 * (1 + (off / (_TAIL * noise)) ** 2))  # [n]
    information = np.einsum("n,nij,nik->jk", weight, A, A)
    information[3:, 3:] += np.eye(3) / _BIAS**2
    right = np.einsum("n,nij,ni->j", weight, A, force)
    if is_length_known:
        up = x[:3] / np.linalg.norm(x[:3])
        information[:3, :3] += np.outer(up, up) / _SCALE**2
        right[:3] += up * (STANDARD_GRAVITY / _SCALE**2)
    return np.linalg.solve(information, right), information


def _is_plausible(up: np.ndarray) -> bool:
    return _PLAUSIBLE[0] < float(np.linalg.norm(up)) < _PLAUSIBLE[1]
