"""Frames of noisy depth; apart, as tests of the noise, of tracking and of the doctor use them."""

from dataclasses import replace

import numpy as np

from hsslam_node.frame import Frame
from tests.small_room import room_frames

SHAPE = room_frames()[0].depth_raw.shape
_UNITS_PER_M = 20_000.0


def noisy_plane(noise: np.ndarray) -> Frame:
    """A slanted plane whose inverse depth has the noise [H, W], 1/m."""
    raw = np.rint(_UNITS_PER_M / (np.linspace(0.7, 0.4, SHAPE[1]) + noise)).astype(np.uint16)
    return replace(room_frames()[0], depth_raw=raw, depth_units_per_m=_UNITS_PER_M)


def with_white_noise(frame: Frame, sigma: float) -> Frame:
    """The frame with independent noise of this deviation, 1/m, in its inverse depth."""
    noise = np.random.default_rng(0).normal(0, sigma, frame.depth_raw.shape)
    noisy_m = 1 / (1 / np.maximum(frame.depth_m(), 0.1) + noise)
    raw = np.where(frame.depth_raw > 0, noisy_m * frame.depth_units_per_m, 0).astype(np.uint16)
    return replace(frame, depth_raw=raw)
