"""How far the edges of the colour image lie from those of depth."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

REACH_PX = 24  # of an image 640 pixels wide; also how far is searched
_WIDTH_PX = 640
_STEP_PX = (
    3  # a jump of depth is looked for across twice that, so that a seam without depth is bridged
)
_JUMP = 0.10  # of the depth
_BRIGHTEST = 97.0  # percentile at which gradients are cut: no single edge rules
_AROUND_PX = 41  # a gradient counts by what it has over its surroundings
_PEAK_PX = 9  # around the peak; what lies outside is what chance gives
_LEAST_PEAK = 1.8  # of the largest value outside
_LEAST_EDGES = 2000  # pixels


@dataclass(frozen=True)
class EdgeShift:
    """Along one axis: colour edges lie `shift_px` (full image) right of, or below, depth edges."""

    shift_px: float
    contrast: float  # peak over the largest value away from it
    clear: bool  # enough edges, one peak


def edge_shifts(
    images: Iterable[tuple[np.ndarray, np.ndarray]],
) -> tuple[EdgeShift, EdgeShift] | None:
    """Shifts in x and y over pairs of colour [H, W, 3] uint8 and depth [H, W] m (0 = none).

    The gradient of the image across each jump of depth, summed over all frames for each shift; its
    peak, to a fraction of a pixel. None where there is no image.
    """
    sums, counts, factor = np.zeros((2, 2 * REACH_PX + 1)), np.zeros(2), 1.0
    for color, depth_m in images:
        factor = max(color.shape[1] / _WIDTH_PX, 1e-9)
        size = (_WIDTH_PX, max(round(color.shape[0] / factor), 4 * REACH_PX))
        grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        grey = cv2.GaussianBlur(grey, (0, 0), 1.0)
        depth = cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST)
        for axis in (0, 1):  # x, y
            gradient = _gradient(grey, axis)
            jump = _jumps(depth, axis)
            counts[axis] += np.count_nonzero(jump)
            sums[axis] += _sum_by_shift(gradient, jump, axis)
    if not counts.any():
        return None
    x, y = (_peak(sums[axis] / max(counts[axis], 1), counts[axis], factor) for axis in (0, 1))
    return x, y


def _gradient(grey: np.ndarray, axis: int) -> np.ndarray:
    """|gradient| along an axis, cut at the top and less its surroundings, [H, W] float32."""
    size = np.abs(cv2.Scharr(grey, cv2.CV_32F, 1 - axis, axis))
    size = np.minimum(size, np.percentile(size[::2, ::2], _BRIGHTEST))
    return size - cv2.blur(size, (_AROUND_PX, _AROUND_PX))


def _jumps(depth: np.ndarray, axis: int) -> np.ndarray:
    """Pixels in the middle of a jump of depth, away from the border, [h, w] bool."""
    margin = slice(REACH_PX + _STEP_PX, -REACH_PX - _STEP_PX)
    before = np.roll(depth, _STEP_PX, 1 - axis)[margin, margin]
    after = np.roll(depth, -_STEP_PX, 1 - axis)[margin, margin]
    nearer = np.minimum(before, after)
    return (nearer > 0) & (np.abs(before - after) > _JUMP * nearer)


def _sum_by_shift(gradient: np.ndarray, jump: np.ndarray, axis: int) -> np.ndarray:
    """Sum of the gradient at the jumps moved by -REACH_PX to REACH_PX pixels."""
    row, column = (index + REACH_PX + _STEP_PX for index in np.nonzero(jump))
    shifts = range(-REACH_PX, REACH_PX + 1)
    if axis == 0:
        return np.array([gradient[row, column + s].sum() for s in shifts], np.float64)
    return np.array([gradient[row + s, column].sum() for s in shifts], np.float64)


def _peak(curve: np.ndarray, edges: float, factor: float) -> EdgeShift:
    top = int(np.argmax(curve))
    away = np.abs(np.arange(len(curve)) - top) > _PEAK_PX
    contrast = float(curve[top] / max(np.abs(curve[away]).max(), 1e-9))
    fine = float(top)
    if 0 < top < len(curve) - 1:
        a, b, c = curve[top - 1 : top + 2]
        fine += 0.5 * (a - c) / min(a - 2 * b + c, -1e-9)
    clear = bool(edges >= _LEAST_EDGES and contrast >= _LEAST_PEAK)
    return EdgeShift(float(fine - REACH_PX) * factor, contrast, clear)
