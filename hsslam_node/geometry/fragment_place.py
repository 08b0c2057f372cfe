"""Where a fragment lies in the map; apart, as both the search of its place and its trackers need it."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.geometry.pose_covariance import carried, turned

_UNSURE = np.diag(np.repeat([0.02**2, 0.01**2], 3))  # covariance (m, rad) where the two have met


@dataclass(frozen=True)
class FragmentPlace:
    """The pose of a fragment in the map, and the place where the two have met: there it is surest."""

    T_map_fragment: np.ndarray  # [4, 4]
    met_m: np.ndarray  # [3], in the fragment

    def covariance(self, in_fragment: np.ndarray, T_fragment_cam: np.ndarray) -> np.ndarray:
        """Covariance [6, 6] in the map of the pose T_fragment_cam [4, 4], which has covariance `in_fragment`
        [6, 6] in the fragment.

        An error of rotation moves the pose the more, the farther it is from the meeting.
        """
        R = self.T_map_fragment[:3, :3]
        lever_m = R @ (T_fragment_cam[:3, 3] - self.met_m)
        return turned(in_fragment, R) + carried(_UNSURE, lever_m)
