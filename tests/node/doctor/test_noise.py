"""The doctor on the noise of depth."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from hsslam_node.doctor.noise import check_depth_noise
from hsslam_node.frame import Frame
from tests.small_room import room_frames, with_black

_UNITS_PER_M = 20_000.0
_SHAPE = room_frames()[0].depth_raw.shape


def _plane(noise: np.ndarray) -> Frame:
    """A slanted plane whose inverse depth has the noise [H, W], 1/m."""
    raw = np.rint(_UNITS_PER_M / (np.linspace(0.7, 0.4, _SHAPE[1]) + noise)).astype(np.uint16)
    return replace(room_frames()[0], depth_raw=raw, depth_units_per_m=_UNITS_PER_M)


def _white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 1, _SHAPE)


def test_independent_noise_is_averaged():
    found = check_depth_noise([_plane(2e-3 * _white(seed)) for seed in range(3)])
    assert found.severity == "ok" and found.seen.endswith("the tracker averages them")
    assert found.value == pytest.approx(8.0, rel=0.1)


def test_noise_that_neighbours_share_is_not_averaged():
    shared = cv2.GaussianBlur(_white(0), (0, 0), 3.0)
    found = check_depth_noise([_plane(2e-3 * shared / shared.std())])
    assert found.severity == "ok" and found.seen.endswith("the tracker does not average them")


def test_much_noise_is_a_note():
    found = check_depth_noise([_plane(1e-2 * _white(0))])
    assert found.severity == "note" and "emitter" in found.advice


def test_rendered_depth_and_none():
    assert check_depth_noise(room_frames()[:2]).seen == "below 0.8 mm at 2 m"
    assert check_depth_noise([with_black(room_frames()[0])]).value is None
