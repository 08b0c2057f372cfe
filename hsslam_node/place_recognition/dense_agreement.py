"""Whether two whole frames agree on a relative pose: depth both ways, and grey levels."""

from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.projection import project
from hsslam_node.geometry.se3 import inverse

_STEP_PX = 8  # at 640 px width
_TOLERANCE_M, _TOLERANCE_SLOPE = 0.03, 0.01  # depths agree within first + second z^2, m
_BLUR_PX = 2.0  # at 640 px width: poses are good to some pixels only
_FEWEST = 30  # points for a correlation
_LEAST_CONTRAST = 2.0  # deviation of grey levels: less is dark, blown out, a bare wall, or noise


@dataclass(frozen=True)
class DenseAgreement:
    """How well depth images and grey images agree on a relative pose."""

    overlap: float  # share of a frame's points on the other's surface, the smaller of the two
    consistency: float  # agreeing over agreeing and contradicting points, the smaller; 0 if none
    similarity: float  # correlation of grey levels at agreeing points, -1..1; 0 without any; nan: no contrast
    residual_m: float  # median depth difference of agreeing points; nan without any


def dense_agreement(first: Frame, second: Frame, T_first_second: np.ndarray) -> DenseAgreement:
    """Compare on a grid of pixels, in both directions.

    A point behind the other frame's surface is hidden there and does not count. A point in front of
    it should be visible there, so it contradicts the pose.
    """
    forth = _compare(second, first, T_first_second)
    back = _compare(first, second, inverse(T_first_second))
    residual_m = np.concatenate([forth.residuals_m, back.residuals_m])
    return DenseAgreement(
        overlap=min(forth.overlap, back.overlap),
        consistency=min(forth.consistency, back.consistency),
        similarity=float(np.minimum(forth.similarity, back.similarity)),  # nan if either is
        residual_m=float(np.median(residual_m)) if len(residual_m) else float("nan"),
    )


@dataclass(frozen=True)
class _OneWay:
    overlap: float
    consistency: float
    similarity: float
    residuals_m: np.ndarray  # [n]


def _compare(source: Frame, target: Frame, T_target_source: np.ndarray) -> _OneWay:
    camera = source.camera
    step = max(1, round(_STEP_PX * camera.width_px / 640))
    v, u = np.mgrid[step // 2 : camera.height_px : step, step // 2 : camera.width_px : step]
    z = source.depth_raw[v, u] / source.depth_units_per_m
    known = z > 0
    u, v, z = u[known], v[known], z[known]
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], -1)
    to = target.camera
    i, j, depth = project(points, to, T_target_source)
    i, j = np.rint(i), np.rint(j)
    inside = (depth > 0.1) & (i >= 0) & (j >= 0) & (i < to.width_px) & (j < to.height_px)
    i, j, depth = i[inside].astype(int), j[inside].astype(int), depth[inside]
    measured = target.depth_raw[j, i] / target.depth_units_per_m
    difference = depth - measured
    tolerance = _TOLERANCE_M + _TOLERANCE_SLOPE * depth**2
    agree = (measured > 0) & (np.abs(difference) < tolerance)
    against = (measured > 0) & (difference < -tolerance)
    n = int(agree.sum())
    grey = _grey(source)[v[inside][agree], u[inside][agree]], _grey(target)[j[agree], i[agree]]
    return _OneWay(
        overlap=n / max(len(z), 1),
        consistency=n / max(n + int(against.sum()), 1),
        similarity=_correlation(*grey),
        residuals_m=np.abs(difference[agree]),
    )


def _grey(frame: Frame) -> np.ndarray:
    sigma = _BLUR_PX * frame.camera.width_px / 640
    return cv2.GaussianBlur(cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY), (0, 0), sigma)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    if len(a) < _FEWEST:
        return 0.0
    if min(a.std(), b.std()) < _LEAST_CONTRAST:
        return float("nan")
    a, b = a - a.mean(), b - b.mean()
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
