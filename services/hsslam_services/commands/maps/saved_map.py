"""A saved map, ready to be asked by the offline commands."""

from pathlib import Path

import numpy as np

from hsslam_node.device.choose_device import DeviceChoice, choose_device
from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.checkpoint import MapCheckpoint, load_checkpoint
from hsslam_node.map.keyframe_images import KeyframeImages
from hsslam_node.meshing.map_queries import open_map_queries
from hsslam_node.rendering.sdf_ray_caster import SdfRayCaster

_WIDTH_PX, _HEIGHT_PX, _FOCAL_PX = 640, 480, 525.0  # where the map does not tell its camera


class SavedMap:
    """The map of a file with its queries, rays and camera.

    Raises:
        UserError: no such file, another format or version, a damaged file; the device.
    """

    def __init__(self, path: Path, device: DeviceChoice = "auto") -> None:
        self._path = path
        self.checkpoint: MapCheckpoint = load_checkpoint(path)
        layout = self.checkpoint.layout
        self.queries = open_map_queries(layout, self.checkpoint.params, choose_device(device))
        self.rays = SdfRayCaster(self.queries.sdf, layout.bound, layout.config.truncation_m)
        center = (_WIDTH_PX - 1) / 2, (_HEIGHT_PX - 1) / 2
        self.camera = self.checkpoint.camera or Camera(
            _WIDTH_PX, _HEIGHT_PX, _FOCAL_PX, _FOCAL_PX, *center
        )

    def measured_depth_m(self, images: KeyframeImages, k: int) -> np.ndarray:
        """Depth [H, W] float32 m as keyframe k measured it; UserError where it cannot be decoded."""
        try:
            depth_raw = images.pixels(k)[1]
        except ValueError as error:
            raise UserError(f"{self._path}: damaged map: {error}") from None
        if depth_raw.shape != (self.camera.height_px, self.camera.width_px):
            raise UserError(f"{self._path}: damaged map: keyframe {k} is not of its camera's size")
        return depth_raw * np.float32(1.0 / images.depth_units_per_m)  # as of a Frame
