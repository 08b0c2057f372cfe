"""The bound of the map: a box from the first frame, and when and how far it grows."""

import numpy as np

from hsslam_node.config import BoundConfig
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import camera_points, world_points


def first_pose(config: BoundConfig) -> np.ndarray:
    """T_world_cam [4, 4] of the first camera: the world's origin, if none is configured."""
    T_world_cam = np.eye(4)
    if config.first_camera:
        T_world_cam[:3] = np.reshape(config.first_camera, (3, 4))
    return T_world_cam


def initial_bound(frame: Frame, config: BoundConfig, max_depth_m: float) -> Bound:
    """The box that is configured, else one about the first camera (the world's origin) that reaches past
    what it sees.

    The room goes on behind the camera, so the reach is the same in all directions but up and down,
    where rooms are lower: `margin` times the 99th percentile of the distance of the measured
    points, within `least_m` and `most_m`; along y 0.4 of that, but no less than `least_m`.

    Raises:
        UserError: the frame has no depth.
    """
    if config.box:
        return Bound.of(np.array(config.box[:3]), np.array(config.box[3:]))
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


_SHARE = 0.02  # of a keyframe's points that may lie outside
_STRIDE_PX = 8
_HEIGHT = 0.4  # rooms are lower than they are wide


def wanted_bound(
    bound: Bound,
    depth_m: np.ndarray,
    camera: Camera,
    T_world_cam: np.ndarray,
    config: BoundConfig,
    max_depth_m: float,
) -> Bound | None:
    """The box to grow to for a keyframe, None where it lies within the bound.

    It grows where the camera is outside, or more than 2 % of the measured points are: past the
    points but for the outermost 1 %, and by `growth_m` more, so that it seldom grows.

    Args:
        bound: of the map now; the box returned may be smaller where nothing was seen.
        depth_m: [H, W] float32, planar, 0 = no measurement.
        T_world_cam: [4, 4].
        max_depth_m: farther measurements are ignored.
    """
    near_m = np.where(depth_m < max_depth_m, depth_m, 0)
    points = world_points(near_m, camera, T_world_cam, _STRIDE_PX)
    position = np.asarray(T_world_cam)[:3, 3]
    outside = len(points) > 0 and bool((~bound.contains(points)).mean() > _SHARE)
    if not outside and bound.contains(position[None])[0]:
        return None
    low = high = position
    if len(points) > 0:
        low = np.minimum(position, np.quantile(points, 0.01, axis=0))
        high = np.maximum(position, np.quantile(points, 0.99, axis=0))
    margin = config.growth_m * np.array([1.0, _HEIGHT, 1.0])
    farthest = config.farthest_m
    low = np.where(low < bound.low, np.maximum(low - margin, -farthest), bound.low)
    high = np.where(high > bound.high, np.minimum(high + margin, farthest), bound.high)
    wanted = Bound.of(np.minimum(low, bound.low), np.maximum(high, bound.high))
    return None if wanted == bound else wanted
