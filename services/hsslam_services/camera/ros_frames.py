"""Makes frames from colour and depth images of ROS."""

import itertools

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.depth_registration import DepthMounting, DepthRegistration
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.files.undistortion import Undistortion
from hsslam_node.sources.ros2.raw_image import RawImage, expect_size
from hsslam_node.sources.source import BadFrame

MOST_BROKEN = 30  # undecodable pairs at the start
_SAME_COEFFICIENT = 1e-3  # of one lens: moves no pixel of a usual image by a pixel


def can_be_used(
    pair: tuple[RawImage, RawImage],
    camera: Camera | None,
    depth_camera: Camera | None,
    depth_scale: float | None,
) -> bool:
    """Whether this pair of colour and depth can be decoded and has the camera's size, if that is known.

    Such a pair shows the encodings of the source. `depth_camera`: None if depth is registered to colour.
    `depth_scale`: as of `RosFrames`.
    """
    color, depth = pair
    try:
        if camera is not None:
            color.expect_size(camera)
            depth.expect_size(depth_camera or camera)
        color.color()
        depth.depth(depth_scale)
    except BadImageError:
        return False
    return True


class RosFrames:
    """Makes frames of pairs of images; `camera`: of colour, with its distortion.

    `source`: its name in errors, such as ros2:/camera. `first`: a pair that shows size and encodings.
    `depth_scale`: units per metre; None: those of the encoding. `mounting`: of the depth camera; None if
    depth is registered to colour.

    Raises:
        UserError: the first pair cannot be decoded, or it differs in size from its cameras.
    """

    def __init__(
        self,
        source: str,
        camera: Camera,
        first: tuple[RawImage, RawImage],
        depth_scale: float | None,
        mounting: DepthMounting | None = None,
    ) -> None:
        self._depth_scale = depth_scale
        self._depth_camera = mounting.camera if mounting else camera
        self.depth_units_per_m = _expect_sizes(
            source, camera, self._depth_camera, *first, depth_scale
        )
        self._undistortion = Undistortion(camera)
        self._first = camera
        self.camera = camera.undistorted()
        self._registration = None
        if mounting is not None:
            self._registration = DepthRegistration(
                mounting.camera, self.camera, mounting.T_color_depth, self.depth_units_per_m
            )
        self._changed = ""  # how the newest `camera_info` differs from the first

    def hear_camera(self, camera: Camera) -> None:
        """Take a later `camera_info`; frames are bad while it differs from the first by more than a pixel, or
        has another lens."""
        if camera.differs_in(self._first) is not None:
            now, first = (_image_text(c) for c in (camera, self._first))
        elif not _is_same_lens(camera, self._first):
            now, first = (_lens_text(c) for c in (camera, self._first))
        else:
            self._changed = ""
            return
        self._changed = f"{now}: expected {first} as at first"

    def frame(self, index: int, color: RawImage, depth: RawImage) -> Frame | BadFrame:
        """The undistorted frame of a pair; a `BadFrame` if the pair cannot be used."""
        try:
            if self._changed:
                raise BadImageError(f"camera_info changed to {self._changed}")
            if color.stamp_ns < 0:
                raise BadImageError("stamp before 1970: expected a time from 0 on")
            cameras = self.camera, self._depth_camera
            for image, camera in zip((color, depth), cameras, strict=True):
                image.expect_size(camera)
            rgb = color.color()
            depth_raw, units = depth.depth(self._depth_scale)
            pixels = (("colour", rgb), ("depth", depth_raw))
            for (name, image), camera in zip(pixels, cameras, strict=True):
                # not all formats show it before
                expect_size(name, image.shape[1], image.shape[0], camera)
            if units != self.depth_units_per_m:
                raise BadImageError(f"depth in encoding {depth.encoding!r}: expected as before")
            return Frame(
                index=index,
                stamp_ns=color.stamp_ns,
                camera=self.camera,
                color=self._undistortion.color(rgb),
                depth_raw=self._registered(depth_raw),
                depth_units_per_m=self.depth_units_per_m,
            )
        except (BadImageError, UserError) as error:
            return BadFrame(index, color.stamp_ns, str(error))

    def _registered(self, depth_raw: np.ndarray) -> np.ndarray:
        """Depth of the pixels of colour, without distortion."""
        if self._registration:
            return self._registration.registered(depth_raw)
        return self._undistortion.depth(depth_raw)


def intrinsics_text(camera: Camera) -> str:
    """fx, fy, cx and cy for errors, px."""
    return ", ".join(f"{value:.1f}" for value in (camera.fx, camera.fy, camera.cx, camera.cy))


def _is_same_lens(one: Camera, other: Camera) -> bool:
    """Whether two lenses have the same model and coefficients; those that are not given are 0."""
    if not (one.has_lens or other.has_lens):
        return True
    if one.distortion_model != other.distortion_model:
        return False
    pairs = itertools.zip_longest(one.distortion, other.distortion, fillvalue=0.0)
    return all(abs(here - there) <= _SAME_COEFFICIENT for here, there in pairs)


def _image_text(camera: Camera) -> str:
    return f"{camera.width_px}x{camera.height_px} with fx, fy, cx, cy = {intrinsics_text(camera)}"


def _lens_text(camera: Camera) -> str:
    numbers = ", ".join(f"{value:.4g}" for value in camera.distortion)
    return f"lens model {camera.distortion_model} with coefficients [{numbers}]"


def _expect_sizes(
    source: str,
    camera: Camera,
    depth_camera: Camera,
    color: RawImage,
    depth: RawImage,
    depth_scale: float | None,
) -> float:
    """Units per metre of depth; raises UserError unless colour and depth have the sizes of their cameras."""
    kind = source.partition(":")[0]
    try:
        height, width = color.color().shape[:2]
    except BadImageError as error:
        raise UserError(f"source {source}: {error} (--{kind}.color)") from None
    try:
        depth_raw, units = depth.depth(depth_scale)
    except BadImageError as error:
        raise UserError(f"source {source}: {error} (--{kind}.depth)") from None
    if (camera.width_px, camera.height_px) != (width, height):
        raise UserError(
            f"source {source}: camera_info is for {camera.width_px}x{camera.height_px} pixels: expected "
            f"{width}x{height} as the images (--{kind}.info)"
        )
    expected = depth_camera.height_px, depth_camera.width_px
    if depth_raw.shape != expected:
        why = (
            "as colour, registered to it (realsense: align_depth.enable:=true)"
            if depth_camera is camera
            else "as its camera_info"
        )
        raise UserError(
            f"source {source}: depth has {depth_raw.shape[1]}x{depth_raw.shape[0]} pixels: expected "
            f"{expected[1]}x{expected[0]} {why}"
        )
    return units
