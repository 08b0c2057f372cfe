"""Noise of a sensor's depth, estimated from one image; mapper and tracker share it."""

import numpy as np

from hsslam_node.frame import Frame

_STEP_PX = 4  # noise of neighbours is correlated in real sensors
_EVERY = 4  # step between rows and columns
_FEWEST = 100
_UNKNOWN = 1.8e-3  # of a Kinect

_DEVIATIONS = 2.0  # of the noise; pixels that differ by more are not on the same surface
_WINDOW_PX = 5  # side of a window whose mean is compared with its middle pixel
_WINDOW_ROWS = 15
_SAME_SURFACE = 4.0  # deviations of a second difference; more is an edge

# of the 25 pixels of a window, to average; 12 to 25 with modelled noise, 3 to 5 of a Kinect v1
LEAST_INDEPENDENT = 8.0
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


def averaging_limit(frame: Frame, window_px: int) -> float:
    """Limit as `surface_limit` for means over windows of this side, 1/m; 0: depth is not averaged.

    It is if the window is larger than a pixel, and the mean much more accurate. Neighbouring pixels of a
    Kinect v1 have nearly the same error. Their mean is as wrong as each of them.
    """
    if window_px < 2:
        return 0.0
    noise = depth_noise(frame)
    if noise < EXACT_NOISE or independent_pixels(frame, noise) < LEAST_INDEPENDENT:
        return 0.0
    return _DEVIATIONS * noise


def independent_pixels(frame: Frame, noise: float) -> float:
    """How many pixels of 5 x 5 have independent noise, 1 to 25; 1 with too little depth.

    It compares second differences along rows: of the mean inverse depth of adjacent windows, and of their
    middle pixels. `noise`: of the inverse depth, 1/m.
    """
    raw, side = frame.depth_raw, _WINDOW_PX
    step_px = max(raw.shape[0] // _WINDOW_ROWS, side)
    tops = np.arange(0, raw.shape[0] - side + 1, step_px)
    columns = raw.shape[1] // side
    strips = raw[tops[:, None] + np.arange(side), : columns * side]  # [n, 5, 5 columns]
    windows = strips.reshape(len(tops), side, columns, side).swapaxes(1, 2)
    known = np.all(windows > 0, axis=(2, 3))  # [n, columns]
    inverse = frame.depth_units_per_m / np.maximum(windows, 1).astype(np.float32)
    of_means = _second_differences(inverse.mean((2, 3)))  # [n, columns - 2]
    of_pixels = _second_differences(inverse[:, :, side // 2, side // 2])
    limit = _SAME_SURFACE * np.sqrt(6.0) * noise
    usable = known[:, :-2] & known[:, 1:-1] & known[:, 2:]
    usable &= (of_means < limit) & (of_pixels < limit)
    if np.count_nonzero(usable) < _FEWEST:
        return 1.0
    # surfaces bend: the median of the means, where few windows are bent; pixels are rounded: their mean
    of_mean = 1.4826 * float(np.median(of_means[usable]))
    of_pixel = 1.2533 * float(of_pixels[usable].mean())
    return min(max((of_pixel / max(of_mean, 1e-12)) ** 2, 1.0), float(side**2))


def _second_differences(x: np.ndarray) -> np.ndarray:
    """Absolute second differences [n, m - 2] along the rows of [n, m]."""
    return np.abs(x[:, :-2] + x[:, 2:] - 2.0 * x[:, 1:-1])
