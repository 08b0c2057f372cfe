"""The keyframes of a map for its queries: poses and measured depth."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.checkpoint import MapCheckpoint
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.meshing.depth_views import DepthViews

_WIDTH_PX, _HEIGHT_PX, _FOCAL_PX = 640, 480, 525.0  # if the map stores no camera
_VIEW_PX = 320  # width of the views of maps without images
DepthOf = Callable[[int], np.ndarray]
CastDepth = Callable[[Camera, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class MapKeyframes:
    """The keyframes of a map, all of one camera.

    `depth_m(k)` is the planar depth [H, W] float32 m of the k-th one, 0 = no measurement.
    """

    camera: Camera  # of the depth
    ids: np.ndarray  # [n] int64, in rising order; a keyframe keeps its id
    stamps_ns: np.ndarray  # [n] int64
    T_world_cam: np.ndarray  # [n, 4, 4]
    depth_m: DepthOf

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def views(self) -> DepthViews:
        """Depth [H, W] m and T_world_cam [4, 4] of each."""
        return DepthViews(self.depth_m, self.T_world_cam)


def keyframes_of_store(store: KeyframeStore) -> MapKeyframes:
    """The keyframes kept now; one that is retired later has no depth, as others see its surfaces."""
    ids = store.kept()

    def depth_m(k: int) -> np.ndarray:
        try:
            return store.frame(int(ids[k])).depth_m()
        except RetiredKeyframeError:
            return np.zeros((store.camera.height_px, store.camera.width_px), np.float32)

    return MapKeyframes(store.camera, ids, store.stamps_ns()[ids], store.poses_of(ids), depth_m)


def keyframes_of_checkpoint(
    checkpoint: MapCheckpoint, path: Path, cast_depth: CastDepth
) -> MapKeyframes:
    """The keyframes of a saved map; `path`: for errors.

    An old map has no images. Then the depth is that of the map from each pose, by `cast_depth` of a camera
    and T_world_cam [4, 4], once a keyframe.
    """
    camera, poses = camera_of(checkpoint), checkpoint.T_world_keyframe
    depth_m = _measured_depth(checkpoint, path, camera)
    if depth_m is None:
        camera = camera.scaled(min(1.0, _VIEW_PX / camera.width_px))
        depth_m = cache(lambda k: cast_depth(camera, poses[k]))
    ids = np.arange(len(poses))
    return MapKeyframes(camera, ids, checkpoint.keyframe_stamps_ns, poses, depth_m)


def camera_of(checkpoint: MapCheckpoint) -> Camera:
    """The camera of the keyframes; a usual one for old maps, which store none."""
    center = (_WIDTH_PX - 1) / 2, (_HEIGHT_PX - 1) / 2
    usual = Camera(_WIDTH_PX, _HEIGHT_PX, _FOCAL_PX, _FOCAL_PX, *center)
    return checkpoint.camera or usual


def _measured_depth(checkpoint: MapCheckpoint, path: Path, camera: Camera) -> DepthOf | None:
    """Returns the depth of the images; None if the map has none."""
    images = checkpoint.images
    if images is None:
        return None

    def depth_m(k: int) -> np.ndarray:
        try:
            depth_raw = images.depth_raw(k)
        except ValueError as error:
            raise UserError(f"{path}: damaged map: {error}") from None
        if depth_raw.shape != (camera.height_px, camera.width_px):
            raise UserError(f"{path}: damaged map: keyframe {k} has another size than its camera")
        return depth_raw * np.float32(1.0 / images.depth_units_per_m)  # as of a Frame

    return depth_m
