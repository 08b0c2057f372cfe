"""Intel RealSense cameras: `--source realsense`."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.cameras.driver import chosen_camera, driver
from hsslam_node.sources.cameras.watched import WatchedCamera
from hsslam_node.sources.files.undistortion import Undistortion
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame

_WAIT_MS = 200
_MOST_APART = 0.6  # of a period, between colour and depth: at most a half and some jitter


class JoinedSets:
    """Tells which sets of images are frames.

    If an image is missing, librealsense fills its set with the image before it of the same stream. Such a set
    has colour and depth of different times, or an image that an earlier frame had.

    rate_hz: of both streams.
    """

    def __init__(self, rate_hz: int) -> None:
        self._most_apart_ms = _MOST_APART * 1000.0 / rate_hz
        self._used_ms = (math.nan, math.nan)  # stamps of the last frame
        self._fault = (
            "colour and depth are not of the same time: the camera's library repeated an image (expected "
            f"{rate_hz} Hz of both; in low light, automatic exposure lowers the rate of colour)"
        )

    def fault(self, color: Any, depth: Any) -> str:
        """Why these two images, each a `frame` of librealsense, are no frame; empty if they are one."""
        stamps_ms = color.get_timestamp(), depth.get_timestamp()
        clocks = {image.get_frame_timestamp_domain() for image in (color, depth)}
        is_apart = len(clocks) == 1 and abs(stamps_ms[0] - stamps_ms[1]) > self._most_apart_ms
        if is_apart or any(a == b for a, b in zip(stamps_ms, self._used_ms, strict=True)):
            return self._fault
        self._used_ms = stamps_ms
        return ""


class RealsenseSource:
    """Colour, and depth aligned to it by Intel's software, as they come.

    Stamps are the camera's, of colour. `should_stop` ends the frames.

    Raises:
        UserError: the package or the camera is missing, or it has no such images.
    """

    def __init__(
        self, options: SourceOptions, should_stop: Callable[[], bool] = lambda: False
    ) -> None:
        rs = expect_realsense(options.realsense.serial)
        wanted = options.realsense
        self._options = options
        config = rs.config()
        if wanted.serial:
            config.enable_device(wanted.serial)
        size = (wanted.width_px, wanted.height_px)
        config.enable_stream(rs.stream.color, *size, rs.format.rgb8, wanted.rate_hz)
        config.enable_stream(rs.stream.depth, *size, rs.format.z16, wanted.rate_hz)
        self._pipeline = rs.pipeline()
        try:
            profile = self._pipeline.start(config)
        except RuntimeError as error:
            raise UserError(
                f"source realsense: {size[0]}x{size[1]} at {wanted.rate_hz} Hz: {error} (expected USB 3, and "
                "--realsense.width-px, --realsense.height-px, --realsense.rate-hz that the camera has)"
            ) from None
        self._align = rs.align(rs.stream.color)
        self._sets = JoinedSets(wanted.rate_hz)
        scale_m = profile.get_device().first_depth_sensor().get_depth_scale()
        stream = profile.get_stream(rs.stream.color).as_video_stream_profile()
        camera = realsense_camera(stream.get_intrinsics())
        self._undistortion = Undistortion(camera)
        self.name = "realsense"
        self._watched = WatchedCamera(
            self.name, self._next, lambda: expect_realsense(wanted.serial), should_stop,
            cable="USB cable",
        )  # fmt: skip
        self.camera = camera.undistorted()
        self.rate_hz = float(wanted.rate_hz)
        self.frame_count: int | None = options.frames
        self.depth_units_per_m = 1.0 / float(scale_m)

    def frames(self, first: int = 0) -> Iterator[Frame | BadFrame]:
        """Frames as they come; a `NoFrame` after each 5 s without one."""
        yield from self._watched.selected(self._options, self._pipeline.stop)

    def _next(self) -> Frame | BadFrame | None:
        is_there, images = self._pipeline.try_wait_for_frames(_WAIT_MS)
        return self._frame(self._align.process(images)) if is_there else None

    def _frame(self, images: Any) -> Frame | BadFrame:
        color, depth = images.get_color_frame(), images.get_depth_frame()
        if not color or not depth:
            missing_ns = round(1e6 * images.get_timestamp())
            return BadFrame(0, missing_ns, "colour or depth is missing")
        stamp_ns = round(1e6 * color.get_timestamp())
        if fault := self._sets.fault(color, depth):
            return BadFrame(0, stamp_ns, fault)
        try:
            return Frame(
                index=0,
                stamp_ns=stamp_ns,
                camera=self.camera,
                color=self._undistortion.color(np.array(color.get_data())),
                depth_raw=self._undistortion.depth(np.array(depth.get_data())),
                depth_units_per_m=self.depth_units_per_m,
            )
        except UserError as error:
            return BadFrame(0, stamp_ns, str(error))


def open_realsense(
    name: str, options: SourceOptions, should_stop: Callable[[], bool]
) -> RealsenseSource:
    """The camera of `--realsense.serial`; its name is always empty."""
    return RealsenseSource(options, should_stop)


def check_realsense(name: str, options: SourceOptions) -> None:
    """Raises UserError if the package or the camera is missing."""
    expect_realsense(options.realsense.serial)


def expect_realsense(serial: str) -> Any:
    """The module pyrealsense2; checks that a camera (of this serial number) exists.

    Raises:
        UserError: which of them is missing.
    """
    rs = driver("realsense", "pyrealsense2", "pyrealsense2")
    devices = rs.context().query_devices()
    found = [device.get_info(rs.camera_info.serial_number) for device in devices]
    chosen_camera("realsense", found, serial, f"--realsense.serial {serial}", "USB 3")
    return rs


def realsense_camera(intrinsics: Any) -> Camera:
    """Camera of `rs.intrinsics`; its five coefficients count as OpenCV's, as in ROS."""
    lens = tuple(float(value) for value in intrinsics.coeffs)
    return Camera(
        width_px=int(intrinsics.width),
        height_px=int(intrinsics.height),
        fx=float(intrinsics.fx),
        fy=float(intrinsics.fy),
        cx=float(intrinsics.ppx),
        cy=float(intrinsics.ppy),
        distortion=lens if any(lens) else (),
    )
