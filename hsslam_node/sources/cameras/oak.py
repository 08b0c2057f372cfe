"""Luxonis OAK-D cameras by depthai 3: `--source oak[:ID]`. Not tried on hardware."""

from collections.abc import Callable, Iterator
from datetime import timedelta
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.cameras.driver import chosen_camera, driver
from hsslam_node.sources.cameras.watched import WatchedCamera
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import BadFrame

_WAIT = timedelta(milliseconds=200)
_SIZE_PX, _STEREO_PX, _RATE_HZ = (640, 480), (640, 400), 30.0
_SAME = timedelta(milliseconds=10)  # between colour and depth of one frame
_DEPTH_UNITS_PER_M = 1000.0


class OakSource:
    """Undistorted colour, and stereo depth aligned to it on the camera, as they come.

    Stamps are the camera's, on the clock of this machine since its start.

    Raises:
        UserError: the package or the camera is missing, or it has no colour camera and stereo pair.
    """

    def __init__(
        self, name: str, options: SourceOptions, should_stop: Callable[[], bool] = lambda: False
    ) -> None:
        dai, info = expect_oak(name)
        self.name = f"oak:{name}" if name else "oak"
        self._options = options
        try:
            self._device = dai.Device(info)
            self._pipeline = dai.Pipeline(self._device)
            self._queue = _pairs(dai, self._pipeline, self._device.getPlatform())
            self._pipeline.start()
        except RuntimeError as error:
            raise UserError(f"source {self.name}: {error}") from None
        lost = (RuntimeError, dai.MessageQueue.QueueException)
        self._watched = WatchedCamera(
            self.name, self._next, lambda: expect_oak(name), should_stop, lost
        )
        first = self._watched.first(self._stop)
        self.camera, self.depth_units_per_m = first.camera, first.depth_units_per_m
        self.rate_hz = _RATE_HZ
        self.frame_count: int | None = options.frames

    def frames(self, first: int = 0) -> Iterator[Frame | BadFrame]:
        """Frames as they come; a `NoFrame` after each 5 s without one."""
        yield from self._watched.selected(self._options, self._stop)

    def _stop(self) -> None:
        self._pipeline.stop()
        self._device.close()

    def _next(self) -> Frame | BadFrame | None:
        pair = self._queue.get(_WAIT)
        return None if pair is None else oak_frame(pair["color"], pair["depth"])


def check_oak(name: str, options: SourceOptions) -> None:
    """Raises UserError if the package or the camera is missing."""
    expect_oak(name)


def expect_oak(device_id: str) -> tuple[Any, Any]:
    """The module depthai, and the `DeviceInfo` of the camera of this id, or of the first.

    Raises:
        UserError: which of them is missing.
    """
    dai = driver("oak", "depthai", "depthai")
    devices = {info.getDeviceId(): info for info in dai.Device.getAllAvailableDevices()}
    asked = f"source oak:{device_id}"
    return dai, devices[chosen_camera("oak", [*devices], device_id, asked, "USB or PoE")]


def oak_frame(color: Any, depth: Any) -> Frame | BadFrame:
    """A frame of two `ImgFrame`: RGB888i without lens distortion, and depth in mm of the same pixels."""
    stamp_ns = color.getTimestamp() // timedelta(microseconds=1) * 1000
    K = np.array(color.getTransformation().getIntrinsicMatrix(), float)
    try:
        return Frame(
            index=0,
            stamp_ns=stamp_ns,
            camera=Camera(
                width_px=color.getWidth(),
                height_px=color.getHeight(),
                fx=float(K[0, 0]),
                fy=float(K[1, 1]),
                cx=float(K[0, 2]),
                cy=float(K[1, 2]),
            ),
            color=np.array(color.getFrame()),
            depth_raw=np.array(depth.getFrame()),
            depth_units_per_m=_DEPTH_UNITS_PER_M,
        )
    except UserError as error:
        return BadFrame(0, stamp_ns, str(error))


def _pairs(dai: Any, pipeline: Any, platform: Any) -> Any:
    """A queue of synchronous colour and depth. The stereo node aligns depth; on RVC4, where it cannot, the
    node ImageAlign does."""
    sockets, node = dai.CameraBoardSocket, dai.node
    color = pipeline.create(node.Camera).build(sockets.CAM_A)
    left, right = (
        pipeline.create(node.Camera)
        .build(socket)
        .requestOutput(_STEREO_PX, fps=_RATE_HZ)
        for socket in (sockets.CAM_B, sockets.CAM_C)
    )  # fmt: skip
    image = color.requestOutput(
        _SIZE_PX, dai.ImgFrame.Type.RGB888i, dai.ImgResizeMode.CROP, _RATE_HZ, True
    )  # True: undistorted
    stereo = pipeline.create(node.StereoDepth).build(
        left, right, presetMode=node.StereoDepth.PresetMode.DEFAULT
    )
    sync = pipeline.create(node.Sync)
    sync.setSyncThreshold(_SAME)
    image.link(sync.inputs["color"])
    if platform == dai.Platform.RVC4:
        align = pipeline.create(node.ImageAlign)
        stereo.depth.link(align.input)
        image.link(align.inputAlignTo)
        align.outputAligned.link(sync.inputs["depth"])
    else:
        image.link(stereo.inputAlignTo)
        stereo.depth.link(sync.inputs["depth"])
    return sync.out.createOutputQueue(maxSize=1)
