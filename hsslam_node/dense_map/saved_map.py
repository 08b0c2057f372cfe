"""A `DenseMap` from a file."""

from pathlib import Path

import numpy as np

from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.keyframes import camera_of, keyframes_of_checkpoint
from hsslam_node.device.choose_device import DeviceChoice, choose_device
from hsslam_node.distance.occupancy import FAR_M
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.checkpoint import MapCheckpoint, load_checkpoint, save_checkpoint
from hsslam_node.map.restore import expect_fitted
from hsslam_node.presets import REALTIME


class SavedMap(DenseMap):
    """The map of a file, such as map.safetensors of a run. `checkpoint`: all that the file holds.

    Examples:
        >>> saved = SavedMap.open("runs/desk/map.safetensors")
        >>> distance_m, gradient, known, certainty = saved.query([[0.5, 0.0, 2.0]])
        >>> free = saved.is_free(Spheres([[0.5, 0.0, 2.0]], radius_m=0.2))
    """

    def __init__(
        self, path: Path, checkpoint: MapCheckpoint, device: DeviceChoice, far_m: float = FAR_M
    ) -> None:
        self.checkpoint = checkpoint
        self._opened_with = (path, checkpoint, device, far_m)
        super().__init__(
            checkpoint.layout,
            checkpoint.params,
            keyframes_of_checkpoint(checkpoint, path, self._depth_of_view),
            checkpoint.sampling or REALTIME.sampling,
            choose_device(device),
            max_depth_m=self.max_depth_m,
            far_m=far_m,
        )

    @classmethod
    def open(
        cls, path: Path | str, device: DeviceChoice = "auto", far_m: float = FAR_M
    ) -> "SavedMap":
        """Read a map that `save` or a run wrote.

        Args:
            path: the file, or the folder of the run.
            device: evaluates the field.
            far_m: surfaces and free space that keyframes saw only from farther do not count in `query` and
                `is_free`.

        Raises:
            UserError: no such file, another format or version, a damaged file, a fragment; the device is not
                usable; `far_m` is not above 0.
        """
        checkpoint = load_checkpoint(Path(path))
        expect_fitted(Path(path), checkpoint)
        return cls(Path(path), checkpoint, device, far_m)

    @property
    def camera(self) -> Camera:
        """The camera that the map was made with; a usual one for old maps, which store none."""
        return camera_of(self.checkpoint)

    @property
    def max_depth_m(self) -> float:
        """Depth beyond this was not mapped; for old maps, which do not store it, the presets' value."""
        return self.checkpoint.max_depth_m or REALTIME.mapper.max_depth_m

    def save(self, path: Path | str) -> None:
        """Write the map as it was read.

        Raises:
            UserError: the file cannot be written.
        """
        save_checkpoint(Path(path), self.checkpoint)

    def __reduce__(self) -> "tuple[type[SavedMap], tuple]":
        """Pickle all that the file held, so that processes of a pool get the map; they look at it anew."""
        return SavedMap, self._opened_with

    def _depth_of_view(self, camera: Camera, T_world_cam: np.ndarray) -> np.ndarray:
        return self._rays.depth(camera, T_world_cam)
