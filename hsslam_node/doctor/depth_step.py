"""The step of inverse depth in which a disparity sensor measures, if it is one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_STEPS = np.geomspace(0.00024, 0.035, 320)  # 1/m
_BINS_PER_STEP = 12  # of the smallest step
_REACH = (0.5, 3.5)  # second differences that tell, in steps
_LEAST_SCORE, _LEAST_SHARE, _LEAST_HALF_SCORE = 0.65, 0.15, 0.55
_SAME_STEP = 0.10  # near and far
_LEAST_DEPTH_RATIO = 1.2  # of the far half to the near half: below, any grid looks like one of 1/z
_SAME_SCORE = (
    0.85  # a grid of p is one of p / 2, too: the coarsest with this much of the best score
)


@dataclass(frozen=True)
class DepthStep:
    """Inverse depth comes in steps of `step_per_m` (1/m); `score` is 1 where it does so exactly."""

    step_per_m: float
    score: float


def find_depth_step(depths_raw: Sequence[np.ndarray], units_per_m: float) -> DepthStep | None:
    """The step in depth images [H, W] uint16 of `units_per_m`, or None where there is none to see.

    Second differences of 1/z along rows and columns are 0 on planes, whatever their slope, but for the
    steps: there they are whole multiples of one step, near and far alike. A grid of z (depth in mm) is
    not one of 1/z: its step would differ between near and far.
    """
    parts = [_second_differences(depth, units_per_m) for depth in depths_raw]
    if not parts:
        return None
    bend, inverse = np.concatenate(parts, axis=1)  # [N], 1/m
    if len(bend) < 1000:
        return None
    middle = float(np.median(inverse))
    far, near = inverse < middle, inverse >= middle
    if not far.any() or inverse[near].mean() < _LEAST_DEPTH_RATIO * inverse[far].mean():
        return None
    score, share = _scores(bend)
    best = _coarsest_peak(score, share)
    if best is None or score[best] < _LEAST_SCORE:
        return None
    about = np.abs(np.log(_STEPS / _STEPS[best])) < _SAME_STEP
    if any(_scores(bend[half])[0][about].max() < _LEAST_HALF_SCORE for half in (far, near)):
        return None
    return DepthStep(float(_STEPS[best]), float(score[best]))


def _second_differences(depth_raw: np.ndarray, units_per_m: float) -> np.ndarray:
    """|second difference| of inverse depth and inverse depth itself, [2, N] float64 1/m."""
    inverse = np.zeros(depth_raw.shape)
    np.divide(units_per_m, depth_raw, out=inverse, where=depth_raw > 0)
    rows, columns = inverse[::2], inverse[:, ::2]
    found = []
    for a, b, c in (
        (rows[:, :-2], rows[:, 1:-1], rows[:, 2:]),
        (columns[:-2], columns[1:-1], columns[2:]),
    ):
        whole = (a > 0) & (b > 0) & (c > 0)
        found.append(np.stack([np.abs(a - 2 * b + c)[whole], b[whole]]))
    return np.concatenate(found, axis=1)


def _scores(bend: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each candidate: mean cosine of 2 pi bend / step within reach, and the share within reach."""
    width = _STEPS[0] / _BINS_PER_STEP
    last = int(_REACH[1] * _STEPS[-1] / width) + 1
    count = np.bincount(np.minimum((bend / width).astype(np.int64), last), minlength=last + 1)
    middle = (np.arange(len(count)) + 0.5) * width
    score, share = np.zeros(len(_STEPS)), np.zeros(len(_STEPS))
    for i, step in enumerate(_STEPS):
        window = slice(int(_REACH[0] * step / width), int(_REACH[1] * step / width))
        within = count[window]
        share[i] = within.sum() / len(bend)
        score[i] = (within * np.cos(2 * np.pi * middle[window] / step)).sum() / max(within.sum(), 1)
    return score, share


def _coarsest_peak(score: np.ndarray, share: np.ndarray) -> int | None:
    likely = np.where(share >= _LEAST_SHARE, score, -1.0)
    high = np.flatnonzero(likely >= _SAME_SCORE * likely.max()) if likely.max() > 0 else []
    if len(high) == 0:
        return None
    last = high[-1]  # the flank of the coarsest peak: go up to its top
    near_last = np.abs(np.log(_STEPS / _STEPS[last])) < _SAME_STEP
    return int(np.argmax(np.where(near_last, likely, -1.0)))
