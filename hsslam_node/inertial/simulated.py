"""A simulated IMU of built-in scenes; apart from real IMUs, as it uses true poses."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from hsslam_node.inertial.gravity import STANDARD_GRAVITY
from hsslam_node.inertial.reading import ImuReading
from hsslam_node.inertial.track import ImuTrack

RATE_HZ = 200.0
# standard deviations, as of a BMI088 (data sheet, typical): noise of 1 s, bias, error of scale
GYRO_NOISE, GYRO_BIAS, GYRO_SCALE = np.deg2rad(0.014), np.deg2rad(1.0), 0.01
FORCE_NOISE, FORCE_BIAS, FORCE_SCALE = 175e-6 * 9.81, 0.02 * 9.81, 0.005


def simulated_imu(
    T_true: np.ndarray, rate_hz: float, up: np.ndarray, noise: float, seed: int
) -> list[ImuReading | None]:
    """Readings of an IMU in the centre of a camera, with its axes, along true poses [N, 4, 4].

    The camera moves on cubic splines through the poses. `noise` multiplies the errors of a cheap IMU: 1 is
    usual, 0 none. Bias and scale do not change. With fewer than two poses there are no readings.

    Args:
        rate_hz: of the poses.
        up: [3] unit length, against gravity in the world of the poses.
    """
    if len(T_true) < 2:
        return [None] * len(T_true)
    end_s = (len(T_true) - 1) / rate_hz
    at_s = np.arange(0.0, end_s + 1 / RATE_HZ, 1 / RATE_HZ)
    turn_rate, force = _exact(T_true, rate_hz, np.minimum(at_s, end_s), up)
    rng = np.random.default_rng((seed, 9))
    of_sample = noise * np.sqrt(RATE_HZ)
    turn_rate = _measured(
        turn_rate, rng, noise * GYRO_SCALE, noise * GYRO_BIAS, of_sample * GYRO_NOISE
    )
    force = _measured(force, rng, noise * FORCE_SCALE, noise * FORCE_BIAS, of_sample * FORCE_NOISE)
    stamps_ns = np.round(1e9 * at_s).astype(np.int64).tolist()
    track, readings, k = ImuTrack(), [], 0
    for n in range(len(T_true)):
        stamp_ns = round(n * 1e9 / rate_hz)
        while k < len(stamps_ns) and (k == 0 or stamps_ns[k - 1] < stamp_ns):
            track.add(stamps_ns[k], turn_rate[k], force[k])
            k += 1
        readings.append(track.at(stamp_ns))
    return readings


def _exact(
    T_true: np.ndarray, rate_hz: float, at_s: np.ndarray, up: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity [S, 3] rad/s and specific force [S, 3] m/s^2 at times [S], axes of the camera."""
    pose_s = np.arange(len(T_true)) / rate_hz
    turning = RotationSpline(pose_s, Rotation.from_matrix(T_true[:, :3, :3]))
    R = turning(at_s).as_matrix()
    acceleration = CubicSpline(pose_s, T_true[:, :3, 3])(at_s, 2) + STANDARD_GRAVITY * up
    return turning(at_s, 1), np.einsum("sji,sj->si", R, acceleration)


def _measured(
    exact: np.ndarray, rng: np.random.Generator, scale: float, bias: float, sigma: float
) -> np.ndarray:
    factor, offset = 1 + scale * rng.standard_normal(3), bias * rng.standard_normal(3)
    return factor * exact + offset + sigma * rng.standard_normal(exact.shape)
