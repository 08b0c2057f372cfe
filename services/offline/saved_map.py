"""A saved map, ready to be asked by the offline commands."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hsslam_node.checkpoint import MapCheckpoint, load_checkpoint
from hsslam_node.device.choose_device import DeviceWish, choose_device
from hsslam_node.geometry.camera import Camera
from hsslam_node.meshing.open_map_queries import open_map_queries
from hsslam_node.rendering.sdf_ray_caster import SdfRayCaster

_WIDTH_PX, _HEIGHT_PX, _FOCAL_PX = 640, 480, 525.0  # where the map does not tell its camera


class SavedMap:
    """The map of a file with its queries, rays and camera.

    Raises:
        UserError: no such file, another format or version, a damaged file; the device.
    """

    def __init__(self, path: Path, device: DeviceWish = "auto") -> None:
        self.checkpoint: MapCheckpoint = load_checkpoint(path)
        layout = self.checkpoint.layout
        self.queries = open_map_queries(layout, self.checkpoint.params, choose_device(device))
        self.rays = SdfRayCaster(self.queries.sdf, layout.bound, layout.config.truncation_m)
        center = (_WIDTH_PX - 1) / 2, (_HEIGHT_PX - 1) / 2
        self.camera = self.checkpoint.camera or Camera(
            _WIDTH_PX, _HEIGHT_PX, _FOCAL_PX, _FOCAL_PX, *center
        )


class KeyframeViews(Sequence[tuple[np.ndarray, np.ndarray]]):
    """Depth [H, W] m of the map's surface, and pose, from each keyframe."""

    def __init__(self, saved: SavedMap, camera: Camera) -> None:
        self._saved = saved
        self._camera = camera
        self._poses = saved.checkpoint.T_world_keyframe
        self._depths: dict[int, np.ndarray] = {}

    def __len__(self) -> int:
        return len(self._poses)

    def __getitem__(self, k: Any) -> Any:
        if not 0 <= k < len(self):
            raise IndexError(k)
        if k not in self._depths:
            self._depths[k] = self._saved.rays.depth(self._camera, self._poses[k])
        return self._depths[k], self._poses[k]
