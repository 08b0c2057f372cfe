"""Checks of depth: how much of it, how far, in which unit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hsslam_node.doctor.finding import Check, Finding
from hsslam_node.geometry.camera import Camera
from hsslam_node.tracking.tracked_frame import whole_share

_FAULT_BELOW, _NOTE_BELOW = 0.20, 0.50
_EMPTY_BELOW = 0.02  # such a frame cannot be tracked
_FAULT_EMPTY, _NOTE_EMPTY = 0.10, 0.0
LEAST_WHOLE = 0.05  # pixels with depth around them: of fewer the tracker finds too few points
FILL_HOLES = "depth has holes in a pattern: fill them when depth is registered to the colour image"
_COVERAGE = Check("depth coverage", "%", "above 50 % of the pixels, no frame without depth")


def check_coverage(depths_raw: Sequence[np.ndarray]) -> Finding:
    """Median share of pixels with depth, %, also with depth around them; depths [H, W] uint16, 0 = none."""
    if not depths_raw:
        return _COVERAGE.note(None, "no frame could be read")
    shares = np.array([np.count_nonzero(depth) / depth.size for depth in depths_raw])
    median, empty = float(np.median(shares)), float((shares < _EMPTY_BELOW).mean())
    seen = (
        f"{100 * median:.0f} % of the pixels have depth (least {100 * shares.min():.0f} %); "
        f"{100 * empty:.0f} % of the frames have none"
    )
    advice = (
        "keep 0.5 to 4 m from surfaces; sunlight, glass, mirrors and black things give no depth; check "
        "that the emitter is on and not covered"
    )
    if median < _FAULT_BELOW or empty > _FAULT_EMPTY:
        return _COVERAGE.fault(100 * median, seen, advice)
    whole = float(np.median([whole_share(depth) for depth in depths_raw]))
    if whole < LEAST_WHOLE:
        seen += f"; {100 * whole:.0f} % of the pixels have depth with depth around them"
        return _COVERAGE.fault(100 * median, seen, FILL_HOLES)
    if median < _NOTE_BELOW or empty > _NOTE_EMPTY:
        return _COVERAGE.note(100 * median, seen, advice)
    return _COVERAGE.ok(100 * median, seen)


_FAULT_BELOW_M, _NOTE_BELOW_M = 0.40, 0.60  # nearest that structured light measures: 0.35 to 0.8 m
_NOTE_ABOVE_M, _FAULT_ABOVE_M = 5.0, 8.0
_DEPTH_RANGE = Check("depth range", "m", "median of 0.6 to 5 m")


def check_depth_range(depths_raw: Sequence[np.ndarray], units_per_m: float) -> Finding:
    """Median depth, m, of images [H, W] uint16 (0 = none) of `units_per_m`.

    Checks plausibility only: a wrong scale passes if the depth looks like that of a room.
    """
    values = [depth[::4, ::4] for depth in depths_raw]
    raw = np.concatenate([v[v > 0] for v in values]) if values else np.zeros(0, np.uint16)
    if raw.size == 0:
        return _DEPTH_RANGE.note(None, "no pixel has depth")
    near_m, median_m, far_m = np.percentile(raw, (1, 50, 99)) / units_per_m
    seen = (
        f"depth of {near_m:.2f} to {far_m:.2f} m (1st and 99th percentile), median {median_m:.2f} m"
    )
    value = float(median_m)
    if value < _FAULT_BELOW_M or value > _FAULT_ABOVE_M:
        how = "small: the depth scale" if value < _FAULT_BELOW_M else "large: the depth scale"
        wrong = "large" if value < _FAULT_BELOW_M else "small"
        advice = (
            f"depth looks too {how} of {units_per_m:g} units per metre is probably too {wrong} (common: 1000 "
            "for mm, 5000 in TUM, 6553.5 in Replica)"
        )
        return _DEPTH_RANGE.fault(value, seen, advice)
    if value < _NOTE_BELOW_M or value > _NOTE_ABOVE_M:
        advice = (
            f"measure a known length: is the depth scale of {units_per_m:g} units per metre right?"
        )
        return _DEPTH_RANGE.note(value, seen, advice)
    return _DEPTH_RANGE.ok(value, seen)


# Kinect, Xtion and the like: eighths of a pixel, 580 pixels focal length, 7.5 cm between projector and
# camera: 1 / (8 * 580 * 0.075 m) (Khoshelham and Elberink, Sensors 2012).
_KINECT_STEP_PER_M = 0.00287
_TOLERANCE = 1.3  # the Structure sensor has 1.17 of that
_KINECT_FOCAL_PER_WIDTH = (0.76, 0.94)
_KINECT_ASPECT = 4 / 3
_USUAL_UNITS = (1000.0, 4000.0, 5000.0, 6553.5, 10000.0)
_DEPTH_SCALE = Check(
    "depth scale", "x", "steps of inverse depth of 0.0029 per metre, as a Kinect has, or none"
)


def check_depth_scale(
    depths_raw: Sequence[np.ndarray], units_per_m: float, camera: Camera
) -> Finding:
    """Factor by which depth is too large; depths [H, W] uint16 (0 = none) of `units_per_m`.

    Without ground truth, only something of known size gives the scale. Kinect-like sensors have it: the
    steps of their inverse depth are all the same. This finds factors from 1.3 to 12 either way, in raw
    or registered depth that was not smoothed. Other sensors and rendered depth have no such steps; then
    only `check_depth_range` helps.
    """
    step = find_depth_step(depths_raw, units_per_m)
    if step is None:
        seen = "depth has no steps of a Kinect-like sensor: its scale cannot be checked"
        return _DEPTH_SCALE.ok(None, seen)
    factor = _KINECT_STEP_PER_M / step.step_per_m
    seen = f"inverse depth comes in steps of {step.step_per_m:.5f} per metre"
    if 1 / _TOLERANCE < factor < _TOLERANCE:
        return _DEPTH_SCALE.ok(factor, f"{seen}, as a Kinect's does")
    size = f"{factor:.2g} times too large" if factor > 1 else f"{1 / factor:.2g} times too small"
    advice = (
        f"the depth scale is {units_per_m:g} units per metre: expected about "
        f"{_usual(units_per_m * factor):g}"
    )
    if _like_a_kinect(camera):
        seen += f": for a Kinect-like sensor depth is {size}"
        return _DEPTH_SCALE.fault(factor, seen, advice)
    seen += f": depth is {size} if this is a Kinect-like sensor, but its lens differs"
    return _DEPTH_SCALE.note(factor, seen, f"if it is: {advice}")


def _like_a_kinect(camera: Camera) -> bool:
    low, high = _KINECT_FOCAL_PER_WIDTH
    aspect = camera.width_px / camera.height_px
    return low < camera.fx / camera.width_px < high and abs(aspect - _KINECT_ASPECT) < 0.03


def _usual(units_per_m: float) -> float:
    """The usual scale within 15 %, or else the number itself to two digits."""
    near = min(_USUAL_UNITS, key=lambda usual: abs(np.log(usual / units_per_m)))
    return near if abs(np.log(near / units_per_m)) < 0.15 else float(f"{units_per_m:.2g}")


_STEPS = np.geomspace(0.00024, 0.035, 320)  # 1/m
_BINS_PER_STEP = 12  # of the smallest step
_REACH = (0.5, 3.5)  # second differences that count, in steps
_LEAST_SCORE, _LEAST_SHARE, _LEAST_HALF_SCORE = 0.65, 0.15, 0.55
_SAME_STEP = 0.10  # near and far
_LEAST_DEPTH_RATIO = 1.2  # of the far half to the near half: below, any grid looks like one of 1/z
# a grid of p also fits p / 2: the coarsest with this share of the best score
_SAME_SCORE = 0.85


@dataclass(frozen=True)
class DepthStep:
    """Inverse depth comes in steps of `step_per_m` (1/m); `score` is 1 if the steps are exact."""

    step_per_m: float
    score: float


def find_depth_step(depths_raw: Sequence[np.ndarray], units_per_m: float) -> DepthStep | None:
    """The step in depth images [H, W] uint16 of `units_per_m`, or None if there is none.

    Second differences of 1/z along rows and columns are 0 on planes of any slope. Steps make them whole
    multiples of one step, near and far alike. A grid of z (depth in mm) is not one of 1/z: its step
    differs between near and far.
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
