"""Gravity of a walk through the room, by an IMU as cheap ones are; and when it is not known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_exp, so3_exp
from hsslam_node.inertial.gravity import (
    STANDARD_GRAVITY,
    Gravity,
    GravityFit,
    GravityWindows,
    fit_gravity,
)
from hsslam_node.inertial.gyro_bias import GyroBias
from hsslam_node.inertial.reading import motion_between
from hsslam_node.inertial.simulated import GYRO_BIAS, simulated_imu
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.synth import synth_truth

_UP = np.array([0.0, 0.0, 1.0])


def _fit_after(
    T: np.ndarray, seed: int, *, noise: float = 1.0, scale: float = 1.0
) -> tuple[GravityFit | None, GyroBias]:
    """Of frames at 30 Hz, tracked with errors of 0.3 mm and 0.1 mrad from one to the next."""
    readings = simulated_imu(T, 30.0, scale * _UP, noise, seed)
    windows, bias, rng = GravityWindows(), GyroBias(), np.random.default_rng(seed)
    for k in range(1, len(T)):
        motion = motion_between(readings[k - 1], readings[k])
        assert motion is not None
        error = rng.normal(size=6) * np.repeat([3e-4, 1e-4], 3)
        tracked = inverse(T[k - 1]) @ T[k] @ se3_exp(error)
        bias.learn(motion, tracked[:3, :3])
        windows.add(motion, tracked, k, np.eye(3))
    return windows.fit(T[windows.keyframes, :3, :3]), bias


def _off_deg(fit: GravityFit | None) -> float:
    assert fit is not None and fit.gravity is not None
    return float(np.degrees(np.arccos(np.clip(_UP @ fit.gravity.up, -1, 1))))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_gravity_and_the_bias_of_the_gyroscope_in_a_walk_through_the_room(seed):
    T = synth_truth("room", SourceOptions())[0].T_world_cam
    fit, bias = _fit_after(T, seed)
    assert _off_deg(fit) < 0.1
    true = GYRO_BIAS * _simulated_bias(seed)
    assert np.linalg.norm(bias.value - true) < 0.5 * GYRO_BIAS  # the error of scale looks alike


def _simulated_bias(seed: int) -> np.ndarray:
    """Standard deviations: the second three numbers that the simulation draws."""
    return np.random.default_rng((seed, 9)).standard_normal(6)[3:]


def test_a_camera_that_does_not_turn_cannot_tell_gravity_from_bias():
    T = np.tile(np.eye(4), (300, 1, 1))
    T[:, 0, 3] = 0.3 * np.sin(np.arange(300) / 20)
    fit, _ = _fit_after(T, 0)
    assert fit is not None and fit.gravity is None and fit.sigma_rad > np.deg2rad(1)


@pytest.mark.parametrize("scale", [0.0, 1 / STANDARD_GRAVITY])
def test_an_imu_in_other_units_or_without_gravity_knows_none(scale):
    T = synth_truth("room", SourceOptions(frames=200))[0].T_world_cam
    fit, _ = _fit_after(T, 0, scale=scale)
    assert fit is not None and not fit.is_plausible and fit.gravity is None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.integers(8, 40))
def test_a_fit_is_exact_and_a_fifth_of_wrong_windows_moves_it_little(seed, count):
    rng = np.random.default_rng(seed)
    up = rng.normal(size=3)
    up *= STANDARD_GRAVITY / np.linalg.norm(up)
    bias = rng.normal(size=3) * 0.1
    axes = np.stack([so3_exp(rng.normal(size=3)) for _ in range(count)])
    force = up + axes @ bias
    fit = fit_gravity(force, axes)
    np.testing.assert_allclose(fit.up, up, atol=2e-2)
    force[: count // 5] += rng.normal(size=(count // 5, 3)) * 3
    found = fit_gravity(force, axes).up
    off = np.linalg.norm(np.cross(found, up)) / (np.linalg.norm(found) * STANDARD_GRAVITY)
    assert np.degrees(np.arcsin(off)) < 0.5


def test_a_direction_that_is_none_cannot_be_made():
    with pytest.raises(ValueError, match="expected a direction"):
        Gravity((0.0, 0.0, 2.0), 0.001)


def test_fewer_than_two_poses_are_no_motion_so_they_have_no_readings():
    synth = SynthOptions(imu_noise=1.0, length=3, width_px=32, height_px=32)
    (frame,) = open_source("synth:room", SourceOptions(frames=1, synth=synth)).frames()
    assert isinstance(frame, Frame) and frame.imu is None
    assert open_source("synth:room", SourceOptions(start=9, synth=synth)).frame_count == 0
