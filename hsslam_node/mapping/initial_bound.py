"""The bound of the map from the first frame: no hand-made box."""

import numpy as np

from hsslam_node.config import BoundConfig
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.projection import camera_points


def initial_bound(frame: Frame, config: BoundConfig, max_depth_m: float) -> Bound:
    """A box about the first camera (the world's origin) that reaches past what it sees.

    The room goes on behind the camera, so the reach is the same in all directions but up and down,
    where rooms are lower: `margin` times the 99th percentile of the distance of the measured
    points, within `least_m` and `most_m`; along y 0.4 of that, but no less than `least_m`.

    Raises:
        UserError: the frame has no depth.
    """
    depth_m = frame.depth_m()
    near_m = np.where(depth_m < max_depth_m, depth_m, 0)
    points = camera_points(near_m, frame.camera, stride_px=8)
    if len(points) == 0:
        raise UserError(f"frame {frame.index}: no depth within {max_depth_m} m: expected some")
    distance = np.linalg.norm(points, axis=-1)
    reach = float(
        np.clip(config.margin * np.quantile(distance, 0.99), config.least_m, config.most_m)
    )
    low = max(0.4 * reach, config.least_m)
    return Bound((-reach, -low, -reach), (reach, low, reach))
