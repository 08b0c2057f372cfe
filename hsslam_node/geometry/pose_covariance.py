"""How sure an aligned pose is: a 6x6 covariance from the normal equations of its alignment.

Twists as in `moved_about_camera`: translation (m) of the camera's centre, rotation (rad) about it, both
in world axes. Neighbouring points and pixels err alike, so each term counts for less than its number of
them says, by a factor that is the same for all sequences; `hsslam-bench --only covariance` measures it.
"""

from dataclasses import dataclass

import numpy as np

from hsslam_node.geometry.se3 import skew

_PHOTOMETRIC_CORRELATION = 5.0  # pixels for one that says something of its own
_SURFACE_CORRELATION = 1.5  # points, likewise
_LEAST_COST = 0.05  # a camera that stands still before a film of itself is no better than others
# [6, 6] m, rad: of the motion to a keyframe to which the camera was not tracked from the one before, until
# bundle adjustment has aligned it to others
UNTRACKED = np.diag(np.repeat([0.1**2, 0.05**2], 3))
_KEPT_SHARE = 0.4  # of a keyframe's own variance: bundle adjustment takes the rest out


@dataclass(frozen=True)
class Evidence:
    """The last normal equations of an alignment, and what its two terms of the keyframe added to them.

    A cost is the mean over a term's points or pixels, in units of the variance that the term assumes: 1
    if the residuals are as large as that, whatever they are in truth.
    """

    H: np.ndarray  # [8, 8]: the twist, grey bias, gain
    H_surface: np.ndarray  # [8, 8]
    H_photometric: np.ndarray  # [8, 8]
    surface_cost: float
    photometric_cost: float

    def covariance(self) -> np.ndarray:
        """[6, 6] of the pose against its keyframe.

        A sandwich: each term's share of the information is weighed with the variance of its residuals as
        they are, not as the weights assume. The map's term has a small weight because its errors are
        alike, and stays as it is.
        """
        surface = _SURFACE_CORRELATION * max(self.surface_cost, _LEAST_COST)
        photometric = _PHOTOMETRIC_CORRELATION * max(self.photometric_cost, _LEAST_COST)
        noise = (
            self.H + (surface - 1) * self.H_surface + (photometric - 1) * self.H_photometric
        )  # [8, 8]
        inverse = np.linalg.inv(self.H)
        return (inverse @ noise @ inverse)[:6, :6]


def in_world(covariance: np.ndarray, of_keyframe: np.ndarray, lever_m: np.ndarray) -> np.ndarray:
    """[6, 6] of a pose in the world, from that against its keyframe and that of the keyframe [6, 6].

    lever_m: [3] from the keyframe's centre to the pose's, world axes.
    """
    return covariance + carried(of_keyframe, lever_m)


def of_new_keyframe(
    covariance: np.ndarray, of_keyframe: np.ndarray, lever_m: np.ndarray
) -> np.ndarray:
    """As `in_world`, of a frame that becomes a keyframe itself, once it is adjusted."""
    return _KEPT_SHARE * covariance + carried(of_keyframe, lever_m)


def carried(covariance: np.ndarray, lever_m: np.ndarray) -> np.ndarray:
    """[6, 6] of what is rigidly joined to a pose, `lever_m` [3] from it in the axes of the covariance."""
    J = lever(lever_m)
    return J @ covariance @ J.T


def lever(lever_m: np.ndarray) -> np.ndarray:
    """[6, 6] that maps a small motion (m, rad) to that of what is `lever_m` [3] from its centre."""
    J = np.eye(6)
    J[:3, 3:] = -skew(lever_m)
    return J


def turned(covariance: np.ndarray, R: np.ndarray) -> np.ndarray:
    """[6, 6] in other axes: R [3, 3] maps vectors of the old ones to the new ones."""
    both = np.kron(np.eye(2), R)
    return both @ covariance @ both.T
