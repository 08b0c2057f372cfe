"""The bound of the map: a box from the first frame, and when and how far it grows."""

import numpy as np

from hsslam_node.config import BoundConfig
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import camera_points, world_points


def first_pose(config: BoundConfig) -> np.ndarray:
    """T_world_cam [4, 4] of the first camera: `first_camera` if configured, else the world's origin."""
    T_world_cam = np.eye(4)
    if config.first_camera:
        T_world_cam[:3] = np.reshape(config.first_camera, (3, 4))
    return T_world_cam


def initial_bound(frame: Frame, config: BoundConfig, max_depth_m: float) -> Bound:
    """The configured box, else a box around the first camera (the world's origin) and beyond what it sees.

    The reach is `margin` times the 99th percentile of the distances of the measured points, within `least_m`
    and `most_m`. It is the same in all directions, as the room continues behind the camera, but for y: 0.4
    times the reach, `least_m` at least, as rooms are lower than wide.

    Raises:
        UserError: the frame has no depth within `max_depth_m`.
    """
    if config.box:
        return Bound.of(np.array(config.box[:3]), np.array(config.box[3:]))
    points = _points(frame, max_depth_m)
    if len(points) == 0:
        raise UserError(f"frame {frame.index}: no depth within {max_depth_m} m: expected some")
    distance = np.linalg.norm(points, axis=-1)
    reach = float(
        np.clip(config.margin * np.quantile(distance, 0.99), config.least_m, config.most_m)
    )
    low = max(0.4 * reach, config.least_m)
    return Bound((-reach, -low, -reach), (reach, low, reach))


def may_begin_map(frame: Frame, max_depth_m: float) -> bool:
    """Whether a map may begin with this frame: it has depth that counts, also if its box is given.

    Without such depth the last iterations of the map would have nothing to draw rays from.
    """
    return len(_points(frame, max_depth_m)) > 0


def _points(frame: Frame, max_depth_m: float) -> np.ndarray:
    """Points [N, 3] m, camera axes, of the depth that counts."""
    depth_m = frame.depth_m()
    near_m = np.where(depth_m < max_depth_m, depth_m, 0)
    return camera_points(near_m, frame.camera, _STRIDE_PX)


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
    """The box to grow to for a keyframe; None if the keyframe lies within the bound.

    The box grows if the camera or more than 2 % of the measured points lie outside. It then covers all
    points but the outermost 1 %, plus `growth_m`, so that it seldom grows.

    Args:
        bound: of the map now; the returned box contains it.
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
