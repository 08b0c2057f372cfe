"""The 6x6 covariance of an aligned pose, from the normal equations of its alignment.

Twists as in `moved_about_camera`: translation (m) of the camera's centre, rotation (rad) about it, both
in world axes. Errors of neighbouring points and pixels correlate, so each term counts as fewer of them,
by a factor that is the same for all sequences of averaged depth, and of depth as measured;
`hsslam-bench --only covariance` measures it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hsslam_node.geometry.se3 import skew


class _Factors(NamedTuple):
    """By how much the variance of a term is larger than that of independent residuals of its size."""

    pixels: float
    points: float


# fitted to two sequences (docs/results.md, protocol of `covariance`): depth as measured, and averaged
_AS_MEASURED = _Factors(5.0, 1.5)
_AVERAGED = _Factors(6.0, 0.5)
_LEAST_COST = 0.05  # two equal images do not make a pose certain
# [6, 6] m, rad: of the motion to a keyframe if tracking was lost after the keyframe before it, until
# bundle adjustment has aligned it to others
UNTRACKED = np.diag(np.repeat([0.1**2, 0.05**2], 3))
_KEPT_SHARE = 0.4  # of a keyframe's own variance: bundle adjustment removes the rest


@dataclass(frozen=True)
class Evidence:
    """The last normal equations of an alignment, and the parts that its two keyframe terms added.

    A cost is the mean over a term's points or pixels, in units of the variance that the term assumes: 1
    if the residuals are as large as assumed.
    """

    H: np.ndarray  # [8, 8]: the twist, grey bias, gain
    H_surface: np.ndarray  # [8, 8]
    H_photometric: np.ndarray  # [8, 8]
    surface_cost: float
    photometric_cost: float
    is_averaged: bool = False  # depth of frame and keyframe, over pixels

    def covariance(self) -> np.ndarray:
        """[6, 6] of the pose relative to its keyframe.

        A sandwich estimator: each term's information is scaled by the measured variance of its residuals.
        The map's term is not: it has a small weight already, as its errors correlate.
        """
        factors = _AVERAGED if self.is_averaged else _AS_MEASURED
        surface = factors.points * max(self.surface_cost, _LEAST_COST)
        photometric = factors.pixels * max(self.photometric_cost, _LEAST_COST)
        noise = (
            self.H + (surface - 1) * self.H_surface + (photometric - 1) * self.H_photometric
        )  # [8, 8]
        inverse = np.linalg.inv(self.H)
        return (inverse @ noise @ inverse)[:6, :6]


def in_world(covariance: np.ndarray, of_keyframe: np.ndarray, lever_m: np.ndarray) -> np.ndarray:
    """[6, 6] of a pose in the world, from that relative to its keyframe and the keyframe's [6, 6].

    lever_m: [3] from the keyframe's centre to the pose's, world axes.
    """
    return covariance + carried(of_keyframe, lever_m)


def of_new_keyframe(
    covariance: np.ndarray, of_keyframe: np.ndarray, lever_m: np.ndarray
) -> np.ndarray:
    """As `in_world`, of a frame that becomes a keyframe, after bundle adjustment."""
    return _KEPT_SHARE * covariance + carried(of_keyframe, lever_m)


def carried(covariance: np.ndarray, lever_m: np.ndarray) -> np.ndarray:
    """[6, 6] of a frame fixed to a pose, `lever_m` [3] from it in the axes of the covariance."""
    J = lever(lever_m)
    return J @ covariance @ J.T


def lever(lever_m: np.ndarray) -> np.ndarray:
    """[6, 6] that maps a small motion (m, rad) to that of a frame `lever_m` [3] from its centre."""
    J = np.eye(6)
    J[:3, 3:] = -skew(lever_m)
    return J


def turned(covariance: np.ndarray, R: np.ndarray) -> np.ndarray:
    """[6, 6] in other axes: R [3, 3] maps vectors of the old ones to the new ones."""
    both = np.kron(np.eye(2), R)
    return both @ covariance @ both.T
