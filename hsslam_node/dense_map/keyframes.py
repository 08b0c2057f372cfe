"""The keyframes of a map for its queries: poses, measured depth and colours."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.checkpoint import MapCheckpoint
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.meshing.depth_views import DepthViews
from hsslam_node.rendering.view_blending import PosedImages

_WIDTH_PX, _HEIGHT_PX, _FOCAL_PX = 640, 480, 525.0  # if the map stores no camera
_VIEW_PX = 320  # width of the views of maps without images
_HELD_IMAGES = 16  # decoded: the next view mostly needs the same ones
ImageOf = Callable[[int], np.ndarray]
CastDepth = Callable[[Camera, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class MapKeyframes:
    """The keyframes of a map, all of one camera; its arrays are read-only.

    `depth_m(k)` is the planar depth [H, W] float32 m of the k-th one, 0 = no measurement. `color(k)` is its
    image [H, W, 3] uint8 RGB; None: the map has no images.
    """

    camera: Camera  # of the depth
    ids: np.ndarray  # [n] int64, in rising order; a keyframe keeps its id
    stamps_ns: np.ndarray  # [n] int64
    T_world_cam: np.ndarray  # [n, 4, 4]
    depth_m: ImageOf
    color: ImageOf | None = None

    def __post_init__(self) -> None:
        for array in (self.ids, self.stamps_ns, self.T_world_cam):  # the map reads them later
            array.flags.writeable = False

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def views(self) -> DepthViews:
        """Depth [H, W] m and T_world_cam [4, 4] of each."""
        return DepthViews(self.depth_m, self.T_world_cam)

    @cached_property
    def posed_images(self) -> PosedImages | None:
        """Colour, depth and pose of each, which holds the last images read; None: the map has none."""
        color, depth_m = self.color, self.depth_m  # `image` keeps them, not the keyframes: no cycle
        if color is None:
            return None

        def image(k: int) -> tuple[np.ndarray, np.ndarray]:
            return color(k), depth_m(k)

        return PosedImages(self.camera, self.T_world_cam, lru_cache(_HELD_IMAGES)(image))


def keyframes_of_store(store: KeyframeStore) -> MapKeyframes:
    """The keyframes kept now; one that is retired later has no depth, as others see its surfaces."""
    ids, camera = store.kept(), store.camera
    size = camera.height_px, camera.width_px

    def frame(k: int) -> Frame:
        try:
            return store.frame(int(ids[k]))
        except RetiredKeyframeError:
            color, depth_raw = np.zeros((*size, 3), np.uint8), np.zeros(size, np.uint16)
            return Frame(int(ids[k]), 0, camera, color, depth_raw, store.depth_units_per_m)

    return MapKeyframes(
        camera, ids, store.stamps_ns()[ids], store.poses_of(ids),
        depth_m=lambda k: frame(k).depth_m(),
        color=lambda k: frame(k).color,
    )  # fmt: skip


def keyframes_of_checkpoint(
    checkpoint: MapCheckpoint, path: Path, cast_depth: CastDepth
) -> MapKeyframes:
    """The keyframes of a saved map; `path`: for errors.

    An old map has no images. Then the depth is that of the map from each pose, by `cast_depth` of a camera
    and T_world_cam [4, 4], once a keyframe.
    """
    camera, poses = camera_of(checkpoint), checkpoint.T_world_keyframe
    ids, stamps_ns, images = np.arange(len(poses)), checkpoint.keyframe_stamps_ns, checkpoint.images
    if images is None:
        camera = camera.scaled(min(1.0, _VIEW_PX / camera.width_px))
        depth_m = cache(lambda k: cast_depth(camera, poses[k]))
        return MapKeyframes(camera, ids, stamps_ns, poses, depth_m)
    scale = np.float32(1.0 / images.depth_units_per_m)  # as of a Frame

    def read(image_of: ImageOf, k: int) -> np.ndarray:
        try:
            image = image_of(k)
        except ValueError as error:
            raise UserError(f"{path}: damaged map: {error}") from None
        if image.shape[:2] != (camera.height_px, camera.width_px):
            raise UserError(f"{path}: damaged map: keyframe {k} has another size than its camera")
        return image

    return MapKeyframes(
        camera, ids, stamps_ns, poses,
        depth_m=lambda k: read(images.depth_raw, k) * scale,
        color=lambda k: read(images.color_rgb, k),
    )  # fmt: skip


def camera_of(checkpoint: MapCheckpoint) -> Camera:
    """The camera of the keyframes; a usual one for old maps, which store none."""
    center = (_WIDTH_PX - 1) / 2, (_HEIGHT_PX - 1) / 2
    usual = Camera(_WIDTH_PX, _HEIGHT_PX, _FOCAL_PX, _FOCAL_PX, *center)
    return checkpoint.camera or usual
