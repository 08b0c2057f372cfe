"""The map as the camera would see it now: small, now and then, for the viewer."""

import time

import numpy as np

from hsslam_node.field.layout import FieldLayout
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import rotation_from_quaternion
from hsslam_node.meshing.open_map_queries import Queries
from hsslam_node.proto import topics
from hsslam_node.proto.messages import Pose, View
from hsslam_node.rendering.sdf_ray_caster import SdfRayCaster
from hsslam_node.services.bus import Bus

_WIDTH_PX = 64
_EVERY_S = 2.5  # 52 ms of one core: 0.7 ms a frame at 30 Hz


class ModelView:
    """Publishes what the map looks like from the newest pose."""

    def __init__(self, bus: Bus) -> None:
        self._poses = bus.subscribe(topics.POSE, 1)
        self._views = bus.publisher(topics.VIEW)
        self._next_s = 0.0

    def newest_pose(self) -> Pose | None:
        """The pose to look from, if it is time to look."""
        if time.monotonic() < self._next_s:
            return None
        pose = self._poses.poll()
        if pose is None or pose.status == "lost":
            return None
        self._next_s = time.monotonic() + _EVERY_S
        return pose

    def show(self, pose: Pose, camera: Camera, layout: FieldLayout, queries: Queries) -> None:
        """Cast a ray for each pixel, and publish."""
        camera = camera.scaled(min(1.0, _WIDTH_PX / camera.width_px))
        T_world_cam = np.eye(4)
        T_world_cam[:3, :3] = rotation_from_quaternion(np.array(pose.q))
        T_world_cam[:3, 3] = pose.t
        caster = SdfRayCaster(queries.sdf, layout.bound, layout.config.truncation_m)
        color = model_image(caster, queries, camera, T_world_cam)
        self._views.put(
            View(
                index=pose.index,
                stamp_ns=pose.stamp_ns,
                width_px=camera.width_px,
                height_px=camera.height_px,
                color=color.data.cast("B"),
                world=pose.world,
            )
        )


def model_image(
    caster: SdfRayCaster, queries: Queries, camera: Camera, T_world_cam: np.ndarray
) -> np.ndarray:
    """Colours [H, W, 3] uint8 RGB of the surfaces seen from T_world_cam [4, 4]; black: none."""
    depth_m = caster.depth(camera, T_world_cam)  # [H, W]
    points = world_points(depth_m, camera, T_world_cam)
    image = np.zeros((camera.height_px, camera.width_px, 3), np.uint8)
    if len(points):
        colors = queries.color(points)
        image[depth_m > 0] = np.clip(255 * colors + 0.5, 0, 255).astype(np.uint8)
    return image
