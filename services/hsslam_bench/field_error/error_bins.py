"""Bias and deviation of errors at surface points, by distance and by number of keyframes that saw them."""

from dataclasses import dataclass

import numpy as np

DISTANCES_M = ((0.5, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 5.0))
TIMES_SEEN = ((1, 3), (4, 9), (10, 1 << 30))
TARGET_M, TARGET_TIMES = (1.0, 3.0), TIMES_SEEN[-1]  # the bin that the bounds are for
_FEWEST = 50
_NORMAL = 1.4826  # deviation of a normal distribution over its median absolute deviation


@dataclass(frozen=True)
class Errors:
    """Errors of the points of one bin; nan if there are too few points."""

    points: int
    told: float  # share of the points with a value of the map, 0 to 1
    median_m: float
    mean_m: float
    robust_m: float  # deviation by the median absolute deviation
    deviation_m: float

    @classmethod
    def of(cls, error_m: np.ndarray) -> "Errors":
        """Statistics of signed errors [N], m; nan: the map has no value."""
        known = error_m[np.isfinite(error_m)].astype(np.float64)
        told = len(known) / max(len(error_m), 1)
        if len(known) < _FEWEST:
            return cls(len(error_m), told, *[float("nan")] * 4)
        median = float(np.median(known))
        robust = _NORMAL * float(np.median(np.abs(known - median)))
        return cls(len(error_m), told, median, float(known.mean()), robust, float(known.std()))

    def __str__(self) -> str:
        bias, deviation = 1e3 * self.median_m, 1e3 * self.robust_m
        return f"{bias:+.2f} +- {deviation:.2f} mm ({1e3 * self.deviation_m:.2f})"


def errors_by_bin(error_m: np.ndarray, depth_m: np.ndarray, seen: np.ndarray) -> dict[str, Errors]:
    """Errors by bin, such as "1-2 m, seen 4-9"; arguments [N]. The bounds are for the bin "target"."""
    bins = {
        f"{near:g}-{far:g} m, seen {least}" + (f"-{most}" if most < 1 << 30 else " and more"): (
            (near, far),
            (least, most),
        )
        for near, far in DISTANCES_M
        for least, most in TIMES_SEEN
    }
    bins["target"] = TARGET_M, TARGET_TIMES
    found = {}
    for name, ((near, far), (least, most)) in bins.items():
        mine = (depth_m >= near) & (depth_m < far) & (seen >= least) & (seen <= most)
        found[name] = Errors.of(error_m[mine])
    return found
