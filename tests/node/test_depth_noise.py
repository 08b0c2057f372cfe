"""The noise of a depth image, from the image alone."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from hsslam_node.depth_noise import averaging_limit, depth_noise, independent_pixels, surface_limit
from hsslam_node.frame import Frame
from hsslam_node.sources.effects.kinect_noise import add_kinect_noise
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from tests.noisy_depth import SHAPE, noisy_plane
from tests.small_room import room_frames, with_black


def test_rendered_depth_is_exact():
    assert all(depth_noise(frame) < 2e-4 for frame in room_frames()[::8])


@pytest.mark.parametrize("sigma", [5e-4, 2e-3, 5e-3])
def test_gaussian_noise_of_the_inverse_depth_is_measured(sigma):
    noise = np.random.default_rng(0).normal(0, sigma, SHAPE)
    assert depth_noise(noisy_plane(noise)) == pytest.approx(sigma, rel=0.1)


def test_kinect_noise_of_the_room():
    """1.43e-3 of the sensor model, rounding to an eighth of a pixel, neighbours taken."""
    frame = room_frames()[0]
    raw = add_kinect_noise(frame.depth_raw, frame.depth_units_per_m, 0, 0)
    assert 1.4e-3 < depth_noise(replace(frame, depth_raw=raw)) < 3e-3


def test_without_depth_a_kinect_is_assumed():
    assert depth_noise(with_black(room_frames()[0])) == pytest.approx(1.8e-3)


@pytest.mark.parametrize("sigma", [5e-4, 2e-3, 5e-3])
def test_all_pixels_of_white_noise_are_independent(sigma):
    frame = noisy_plane(np.random.default_rng(0).normal(0, sigma, SHAPE))
    assert independent_pixels(frame, depth_noise(frame)) > 18
    assert averaging_limit(frame, 5) == surface_limit(frame) > 0
    assert averaging_limit(frame, 1) == 0


@pytest.mark.parametrize("blur_px", [2.0, 4.0])
def test_noise_that_neighbours_share_is_not_averaged(blur_px):
    white = np.random.default_rng(0).normal(0, 1, SHAPE)
    shared = cv2.GaussianBlur(white, (0, 0), blur_px)
    frame = noisy_plane(2e-3 * shared / shared.std())
    assert independent_pixels(frame, depth_noise(frame)) < 4
    assert averaging_limit(frame, 5) == 0 < surface_limit(frame)


def test_modelled_kinect_noise_is_averaged_and_exact_depth_is_not():
    frame = room_frames()[0]
    raw = add_kinect_noise(frame.depth_raw, frame.depth_units_per_m, 0, 0)
    noisy = replace(frame, depth_raw=raw)
    assert averaging_limit(noisy, 5) == surface_limit(noisy) > 0
    assert averaging_limit(frame, 5) == averaging_limit(with_black(frame), 5) == 0


def test_a_recorded_kinect_is_not_averaged(test_data):
    """Its neighbouring pixels err alike."""
    source = open_source(f"tum:{test_data / 'kitchen'}", SourceOptions(frames=3))
    for frame in source.frames():
        assert isinstance(frame, Frame)
        noise = depth_noise(frame)
        assert noise > 1e-3
        assert 1 < independent_pixels(frame, noise) < 5
        assert averaging_limit(frame, 5) == 0
