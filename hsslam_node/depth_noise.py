"""Noise of a sensor's depth, estimated from one image; mapper and tracker share it."""

import numpy as np

from hsslam_node.frame import Frame

_STEP_PX = 4  # noise of neighbours is correlated in real sensors
_EVERY = 4  # step between rows and columns
_FEWEST = 100
_UNKNOWN = 1.8e-3  # of a Kinect

_DEVIATIONS = 2.0  # of the noise; pixels that differ by more are not on the same surface

EXACT_NOISE = 2e-4  # 1/m, inverse depth; below this, smoothing costs more than it gives


def depth_noise(frame: Frame) -> float:
    """Standard deviation of the inverse depth, 1/m; times z^2, it is that of the depth z.

    It comes from the median second difference along rows. Inverse depth is linear on a plane, so the
    difference is noise and rounding; edges and curved surfaces are few. About 1e-6 for rendered depth,
    1.8e-3 for a Kinect. An image with too little depth gets 1.8e-3.
    """
    raw = frame.depth_raw[::_EVERY].astype(np.float32)  # [h, W]
    left = raw[:, : -2 * _STEP_PX : _EVERY]
    n = left.shape[1]
    middle = raw[:, _STEP_PX::_EVERY][:, :n]
    right = raw[:, 2 * _STEP_PX :: _EVERY][:, :n]
    known = (left > 0) & (middle > 0) & (right > 0)
    if np.count_nonzero(known) < _FEWEST:
        return _UNKNOWN
    second = 1.0 / left[known] + 1.0 / right[known] - 2.0 / middle[known]
    deviation = 1.4826 * float(np.median(np.abs(second))) / np.sqrt(6.0)
    return deviation * frame.depth_units_per_m


def surface_limit(frame: Frame) -> float:
    """Most difference of inverse depth, 1/m, between neighbours on one surface; 0: depth is exact."""
    noise = depth_noise(frame)
    return 0.0 if noise < EXACT_NOISE else _DEVIATIONS * noise
