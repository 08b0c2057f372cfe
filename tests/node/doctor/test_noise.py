"""The doctor on the noise of depth."""

import cv2
import numpy as np
import pytest

from hsslam_node.doctor.noise import check_depth_noise
from tests.noisy_depth import SHAPE, noisy_plane
from tests.small_room import room_frames, with_black


def _white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 1, SHAPE)


def test_independent_noise_is_averaged():
    found = check_depth_noise([noisy_plane(2e-3 * _white(seed)) for seed in range(3)])
    assert found.severity == "ok" and found.seen.endswith("the tracker averages them")
    assert found.value == pytest.approx(8.0, rel=0.1)


def test_noise_that_neighbours_share_is_not_averaged():
    shared = cv2.GaussianBlur(_white(0), (0, 0), 3.0)
    found = check_depth_noise([noisy_plane(2e-3 * shared / shared.std())])
    assert found.severity == "ok" and found.seen.endswith("the tracker does not average them")


def test_much_noise_is_a_note():
    found = check_depth_noise([noisy_plane(1e-2 * _white(0))])
    assert found.severity == "note" and "emitter" in found.advice


def test_rendered_depth_and_none():
    assert check_depth_noise(room_frames()[:2]).seen == "below 0.8 mm at 2 m"
    assert check_depth_noise([with_black(room_frames()[0])]).value is None
