"""The noise of a depth image, from the image alone."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.depth_noise import depth_noise
from hsslam_node.sources.effects.kinect_noise import add_kinect_noise
from tests.small_room import room_frames, with_black


def test_rendered_depth_is_exact():
    assert all(depth_noise(frame) < 2e-4 for frame in room_frames()[::8])


@pytest.mark.parametrize("sigma", [5e-4, 2e-3, 5e-3])
def test_gaussian_noise_of_the_inverse_depth_is_measured(sigma):
    frame = room_frames()[0]
    units = 20_000.0
    z = 1.5 + np.linspace(0, 1, frame.camera.width_px)[None] * np.ones((frame.camera.height_px, 1))
    inverse_z = 1 / z + np.random.default_rng(0).normal(0, sigma, z.shape)
    raw = np.rint(units / inverse_z).astype(np.uint16)
    noisy = replace(frame, depth_raw=raw, depth_units_per_m=units)
    assert depth_noise(noisy) == pytest.approx(sigma, rel=0.1)


def test_kinect_noise_of_the_room():
    """1.43e-3 of the sensor model, rounding to an eighth of a pixel, neighbours taken."""
    frame = room_frames()[0]
    raw = add_kinect_noise(frame.depth_raw, frame.depth_units_per_m, 0, 0)
    assert 1.4e-3 < depth_noise(replace(frame, depth_raw=raw)) < 3e-3


def test_without_depth_a_kinect_is_assumed():
    assert depth_noise(with_black(room_frames()[0])) == pytest.approx(1.8e-3)
