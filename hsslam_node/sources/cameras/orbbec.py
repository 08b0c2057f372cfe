"""Orbbec cameras by pyorbbecsdk: `--source orbbec[:SERIAL]`. Not tried on hardware."""

import os
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.image_decoding import decoded_rgb
from hsslam_node.image_header import image_header
from hsslam_node.sources.cameras.driver import chosen_camera, driver
from hsslam_node.sources.cameras.watched import WatchedCamera
from hsslam_node.sources.files.undistortion import Undistortion
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame

_WAIT_MS = 200
_WIDTH_PX, _RATE_HZ = 640, 30  # requested; a camera without this mode sends its default
_FROM_YUV = {
    "YUYV": cv2.COLOR_YUV2RGB_YUYV,
    "YUY2": cv2.COLOR_YUV2RGB_YUYV,
    "UYVY": cv2.COLOR_YUV2RGB_UYVY,
}


class OrbbecSource:
    """Colour, and depth aligned to it by Orbbec's software, as they come; stamps are the camera's.

    Raises:
        UserError: the package or the camera is missing, or it sends no such images.
    """

    def __init__(
        self, name: str, options: SourceOptions, should_stop: Callable[[], bool] = lambda: False
    ) -> None:
        sdk, device = expect_orbbec(name)
        self.name = f"orbbec:{name}" if name else "orbbec"
        self._options = options
        self._pipeline = sdk.Pipeline(device)
        try:
            config = sdk.Config()
            config.enable_stream(_color_profile(sdk, self._pipeline))
            depth = self._pipeline.get_stream_profile_list(sdk.OBSensorType.DEPTH_SENSOR)
            config.enable_stream(depth.get_default_video_stream_profile())
            both = sdk.OBFrameAggregateOutputMode.FULL_FRAME_REQUIRE
            config.set_frame_aggregate_output_mode(both)
            self._pipeline.enable_frame_sync()
            self._pipeline.start(config)
        except sdk.OBError as error:
            raise UserError(f"source {self.name}: {error}") from None
        self._align = sdk.AlignFilter(align_to_stream=sdk.OBStreamType.COLOR_STREAM)
        # of colour, to which depth is aligned
        self._lens: tuple[Camera, Undistortion] | None = None
        self._watched = WatchedCamera(
            self.name, self._next, lambda: expect_orbbec(name), should_stop, (sdk.OBError,)
        )
        first = self._watched.first(self._pipeline.stop)
        self.camera, self.depth_units_per_m = first.camera, first.depth_units_per_m
        self.rate_hz = float(_RATE_HZ)
        self.frame_count: int | None = options.frames

    def frames(self, first: int = 0) -> Iterator[Frame | BadFrame]:
        """Frames as they come; a `NoFrame` after each 5 s without one."""
        yield from self._watched.selected(self._options, self._pipeline.stop)

    def _next(self) -> Frame | BadFrame | None:
        images = self._pipeline.wait_for_frames(_WAIT_MS)
        if images is None:
            return None
        aligned = self._align.process(images)
        if aligned is None:
            return None
        both = aligned.as_frame_set()
        color, depth = both.get_color_frame(), both.get_depth_frame()
        if color is None or depth is None:
            return BadFrame(0, 1000 * images.get_timestamp_us(), "colour or depth is missing")
        stamp_ns = 1000 * color.get_timestamp_us()
        try:
            if self._lens is None:
                profile = color.get_stream_profile().as_video_stream_profile()
                camera = orbbec_camera(profile.get_intrinsic(), profile.get_distortion())
                self._lens = camera.undistorted(), Undistortion(camera)
            camera, undistortion = self._lens
            size = color.get_width(), color.get_height()
            image = rgb_image(color.get_data(), color.get_format().name, *size)
            return Frame(
                index=0,
                stamp_ns=stamp_ns,
                camera=camera,
                color=undistortion.color(image),
                depth_raw=undistortion.depth(depth_image(depth.get_data(), *size)),
                depth_units_per_m=1000.0 / float(depth.get_depth_scale()),  # scale: mm of a unit
            )
        except UserError as error:
            return BadFrame(0, stamp_ns, str(error))


def check_orbbec(name: str, options: SourceOptions) -> None:
    """Raises UserError if the package or the camera is missing."""
    expect_orbbec(name)


def expect_orbbec(serial: str) -> tuple[Any, Any]:
    """The module pyorbbecsdk, and the camera of this serial number, or the first.

    Raises:
        UserError: which of them is missing.
    """
    sdk = driver("orbbec", "pyorbbecsdk", "pyorbbecsdk2")
    sdk.Context.set_logger_to_file(sdk.OBLogLevel.NONE, os.devnull)  # else into the current folder
    sdk.Context.set_logger_to_console(sdk.OBLogLevel.NONE)
    devices = sdk.Context().query_devices()
    found = [devices.get_device_serial_number_by_index(i) for i in range(devices.get_count())]
    chosen = chosen_camera("orbbec", found, serial, f"source orbbec:{serial}", "USB 3")
    return sdk, devices.get_device_by_serial_number(chosen)


def orbbec_camera(intrinsic: Any, distortion: Any) -> Camera:
    """The camera of `OBCameraIntrinsic` and `OBCameraDistortion`.

    Raises:
        UserError: the lens model is not one of OpenCV's.
    """
    d, model = distortion, distortion.model.name
    lens = (d.k1, d.k2, d.p1, d.p2, d.k3, d.k4, d.k5, d.k6)
    if not any(lens):
        lens = ()
    elif model == "KANNALA_BRANDT4":
        lens = (d.k1, d.k2, d.k3, d.k4)
    elif model == "BROWN_CONRADY":
        lens = lens[:5]
    elif model != "BROWN_CONRADY_K6":
        raise UserError(
            f"source orbbec: lens model {model}: expected BROWN_CONRADY, BROWN_CONRADY_K6 or KANNALA_BRANDT4"
        )
    return Camera(
        width_px=int(intrinsic.width),
        height_px=int(intrinsic.height),
        fx=float(intrinsic.fx),
        fy=float(intrinsic.fy),
        cx=float(intrinsic.cx),
        cy=float(intrinsic.cy),
        distortion=tuple(map(float, lens)),
        distortion_model="equidistant" if lens and model == "KANNALA_BRANDT4" else "opencv",
    )


def rgb_image(data: np.ndarray, form: str, width: int, height: int) -> np.ndarray:
    """Colour [H, W, 3] uint8 RGB from the bytes of a frame whose `OBFormat` has this name.

    Raises:
        UserError: another format, or the bytes do not fit the size.
    """
    data = np.frombuffer(np.ascontiguousarray(data), np.uint8)
    try:
        if form in ("RGB", "BGR"):
            image = data.reshape(height, width, 3)
            return image.copy() if form == "RGB" else image[..., ::-1].copy()
        if form in _FROM_YUV:
            return cv2.cvtColor(data.reshape(height, width, 2), _FROM_YUV[form])
        if form == "MJPG":
            header = image_header(data.data)
            if header is not None and (header.width_px, header.height_px) == (width, height):
                decoded = decoded_rgb(data)
                if decoded is not None and decoded.shape[:2] == (height, width):
                    return decoded
            raise ValueError
    except ValueError:
        raise UserError(
            f"colour of {len(data)} bytes: expected {form} of {width} x {height}"
        ) from None
    expected = ", ".join(("RGB", "BGR", "MJPG", *_FROM_YUV))
    raise UserError(f"colour has format {form}: expected {expected}")


def depth_image(data: np.ndarray, width: int, height: int) -> np.ndarray:
    """Depth [H, W] uint16 from the bytes of a frame.

    Raises:
        UserError: not the size of colour, to which depth is aligned.
    """
    data = np.frombuffer(np.ascontiguousarray(data), np.uint8)
    if len(data) != 2 * width * height:
        raise UserError(f"depth of {len(data)} bytes: expected 16 bit of {width} x {height}")
    return data.view(np.uint16).reshape(height, width).copy()


def _color_profile(sdk: Any, pipeline: Any) -> Any:
    profiles = pipeline.get_stream_profile_list(sdk.OBSensorType.COLOR_SENSOR)
    try:
        return profiles.get_video_stream_profile(_WIDTH_PX, 0, sdk.OBFormat.RGB, _RATE_HZ)
    except sdk.OBError:
        return profiles.get_default_video_stream_profile()
