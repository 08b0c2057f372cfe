"""Orbbec and OAK-D without hardware: what is missing is one line, and their frames become ours."""

import importlib.util
import resource
from datetime import timedelta

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.cameras.oak import expect_oak, oak_frame
from hsslam_node.sources.cameras.orbbec import depth_image, expect_orbbec, orbbec_camera, rgb_image
from hsslam_node.sources.cameras.rows import OAK, ORBBEC
from hsslam_node.sources.cameras.watched import WatchedCamera
from hsslam_node.sources.source import BadFrame, SourceLostError
from hsslam_services.camera.open_source import check_source_exists, open_any_source
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.source_table import ALL_SOURCES

_COLOR = np.random.default_rng(0).integers(0, 255, (4, 6, 3), np.uint8)


@pytest.mark.parametrize(("kind", "package"), [("orbbec", "pyorbbecsdk"), ("oak", "depthai")])
def test_without_package_or_camera_it_is_one_line(kind, package):
    """As a plugin: found by the entry point of the installed package."""
    assert kind in {row.kind for row in ALL_SOURCES}
    missing = importlib.util.find_spec(package) is None
    words = rf"pip install 'hsslam-node\[{kind}\]'" if missing else "no camera: expected"
    for look in (
        lambda: open_any_source(kind),
        lambda: open_any_source(f"{kind}:0123"),
        lambda: check_source_exists(ServeOptions(kind)),
    ):
        with pytest.raises(UserError, match=f"source {kind}: .*{words}"):
            look()


def test_a_row_takes_the_first_camera_or_one_by_its_number():
    assert ORBBEC.matches("orbbec") and ORBBEC.matches("orbbec:CP1234") and OAK.matches("oak")
    assert not ORBBEC.matches("orbbec:") and not ORBBEC.matches("oak") and not OAK.matches("oa")
    assert ServeOptions("oak").has_camera_process


def test_colour_of_orbbec_in_each_format():
    np.testing.assert_array_equal(rgb_image(_COLOR.ravel(), "RGB", 6, 4), _COLOR)
    np.testing.assert_array_equal(rgb_image(_COLOR[..., ::-1].ravel(), "BGR", 6, 4), _COLOR)
    grey = np.dstack([np.full((4, 6), 100, np.uint8), np.full((4, 6), 128, np.uint8)])
    for form, data in (("YUYV", grey), ("UYVY", grey[..., ::-1])):
        image = rgb_image(data.ravel(), form, 6, 4)
        assert image.shape == (4, 6, 3) and (image == image[0, 0, 0]).all()
    flat = np.full((16, 24, 3), (200, 100, 50), np.uint8)
    jpeg = cv2.imencode(".jpg", flat[..., ::-1])[1]
    assert np.abs(rgb_image(jpeg, "MJPG", 24, 16).astype(int) - flat).max() < 6


@pytest.mark.parametrize(
    ("data", "form", "words"),
    [
        (b"\0" * 70, "RGB", "colour of 70 bytes: expected RGB of 6 x 4"),
        (b"\0" * 70, "MJPG", "colour of 70 bytes: expected MJPG of 6 x 4"),
        (b"", "MJPG", "colour of 0 bytes: expected MJPG of 6 x 4"),
        (b"\0" * 72, "H264", "colour has format H264: expected RGB, BGR, MJPG"),
    ],
)
def test_what_is_no_colour_is_told(data, form, words):
    with pytest.raises(UserError, match=words):
        rgb_image(np.frombuffer(data, np.uint8), form, 6, 4)


def test_a_jpeg_of_another_size_by_its_header_is_not_decoded():
    jpeg = bytearray(cv2.imencode(".jpg", _COLOR)[1])
    size = jpeg.index(b"\xff\xc0") + 5  # height and width, of two bytes each
    jpeg[size : size + 4] = (30_000).to_bytes(2, "big") * 2  # 2.7 GB
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(UserError, match="expected MJPG of 6 x 4"):
        rgb_image(np.frombuffer(jpeg, np.uint8), "MJPG", 6, 4)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 300_000


def test_depth_of_orbbec():
    depth = np.arange(24, dtype=np.uint16).reshape(4, 6) * 700
    np.testing.assert_array_equal(depth_image(depth.view(np.uint8).ravel(), 6, 4), depth)
    with pytest.raises(UserError, match="depth of 48 bytes: expected 16 bit of 6 x 5"):
        depth_image(depth.view(np.uint8).ravel(), 6, 5)


def test_the_lens_of_orbbec():
    sdk = pytest.importorskip("pyorbbecsdk", reason="pyorbbecsdk2 is not installed")
    intrinsic, lens = sdk.OBCameraIntrinsic(), sdk.OBCameraDistortion()
    intrinsic.width, intrinsic.height = 640, 480
    intrinsic.fx, intrinsic.fy, intrinsic.cx, intrinsic.cy = 610.5, 611.0, 321.0, 242.5
    assert not orbbec_camera(intrinsic, lens).has_lens
    lens.k1, lens.k2, lens.p1, lens.p2, lens.k3, lens.k4, lens.k5, lens.k6 = range(1, 9)
    for model, numbers in (
        ("BROWN_CONRADY", (1, 2, 3, 4, 5)),
        ("BROWN_CONRADY_K6", (1, 2, 3, 4, 5, 6, 7, 8)),
        ("KANNALA_BRANDT4", (1, 2, 5, 6)),
    ):
        lens.model = sdk.OBCameraDistortionModel.__members__[model]
        camera = orbbec_camera(intrinsic, lens)
        assert camera.distortion == numbers and (camera.fx, camera.cy) == (610.5, 242.5)
    lens.model = sdk.OBCameraDistortionModel.INVERSE_BROWN_CONRADY
    with pytest.raises(UserError, match="lens model INVERSE_BROWN_CONRADY: expected BROWN"):
        orbbec_camera(intrinsic, lens)


def test_every_name_of_the_orbbec_sdk_is_there():
    sdk = pytest.importorskip("pyorbbecsdk", reason="pyorbbecsdk2 is not installed")
    for owner, names in (
        (sdk.Pipeline, "get_stream_profile_list enable_frame_sync start stop wait_for_frames"),
        (sdk.Config, "enable_stream set_frame_aggregate_output_mode"),
        (sdk.OBFrameAggregateOutputMode, "FULL_FRAME_REQUIRE"),
        (sdk.OBSensorType, "COLOR_SENSOR DEPTH_SENSOR"),
        (sdk.StreamProfileList, "get_video_stream_profile get_default_video_stream_profile"),
        (sdk.StreamProfile, "as_video_stream_profile"),
        (sdk.VideoStreamProfile, "get_intrinsic get_distortion"),
        (sdk.Frame, "as_frame_set get_timestamp_us get_stream_profile get_format get_data"),
        (sdk.FrameSet, "get_color_frame get_depth_frame"),
        (sdk.ColorFrame, "get_width get_height"),
        (sdk.DepthFrame, "get_depth_scale"),
        (sdk.DeviceList, "get_count get_device_by_serial_number get_device_serial_number_by_index"),
        (sdk.OBFormat, "RGB BGR MJPG YUYV YUY2 UYVY"),
    ):
        assert not [name for name in names.split() if not hasattr(owner, name)], owner
    with pytest.raises(UserError, match="no camera"):
        expect_orbbec("")  # first: it keeps the SDK from writing a log into this folder
    sdk.AlignFilter(align_to_stream=sdk.OBStreamType.COLOR_STREAM)


def test_a_frame_of_oak():
    dai = pytest.importorskip("depthai", reason="depthai is not installed")
    depth_mm = np.arange(24, dtype=np.uint16).reshape(4, 6) * 100
    color, depth = dai.ImgFrame(), dai.ImgFrame()
    for image, kind, data in (
        (color, dai.ImgFrame.Type.RGB888i, _COLOR.ravel()),
        (depth, dai.ImgFrame.Type.RAW16, depth_mm.view(np.uint8).ravel()),
    ):
        image.setType(kind), image.setWidth(6), image.setHeight(4), image.setData(data)
    K = [[50.0, 0.0, 2.5], [0.0, 51.0, 1.5], [0.0, 0.0, 1.0]]
    color.setTransformation(dai.ImgTransformation(6, 4, K))
    color.setTimestamp(timedelta(seconds=3, microseconds=7))
    frame = oak_frame(color, depth)
    assert isinstance(frame, Frame)
    np.testing.assert_array_equal(frame.color, _COLOR)
    np.testing.assert_allclose(frame.depth_m(), depth_mm / 1000)
    assert (frame.camera.fx, frame.camera.fy, frame.camera.cx, frame.camera.cy) == (
        50,
        51,
        2.5,
        1.5,
    )
    assert frame.stamp_ns == 3_000_007_000


def test_every_name_of_depthai_is_there():
    dai = pytest.importorskip("depthai", reason="depthai is not installed")
    for owner, names in (
        (dai.Device, "getAllAvailableDevices getPlatform close"),
        (dai.DeviceInfo, "getDeviceId"),
        (dai.Pipeline, "create start stop"),
        (dai.node.Camera, "build requestOutput"),
        (dai.node.StereoDepth, "build depth inputAlignTo PresetMode"),
        (dai.node.ImageAlign, "input inputAlignTo outputAligned"),
        (dai.node.Sync, "inputs out setSyncThreshold"),
        (dai.Node.Output, "link createOutputQueue"),
        (dai.MessageQueue, "get QueueException"),
        (dai.CameraBoardSocket, "CAM_A CAM_B CAM_C"),
        (dai.Platform, "RVC4"),
        (dai.ImgResizeMode, "CROP"),
    ):
        assert not [name for name in names.split() if not hasattr(owner, name)], owner
    with pytest.raises(UserError, match="no camera"):
        expect_oak("")


def test_a_camera_that_is_gone_is_told_from_one_that_is_silent():
    def fails() -> None:
        raise RuntimeError("link is down")

    watched = WatchedCamera("oak", fails, lambda: None, lambda: False, (RuntimeError,))
    with pytest.raises(SourceLostError, match="source oak: link is down"):
        next(watched.frames())
    with pytest.raises(UserError, match="source oak: link is down"):
        watched.first(lambda: None)
    stopped: list[str] = []
    dark = WatchedCamera("oak", lambda: BadFrame(0, 0, "no depth"), lambda: None, lambda: False)
    with pytest.raises(UserError, match=r"source oak: no frame within 0.01 s: no depth"):
        dark.first(lambda: stopped.append("dark"), within_s=0.01)
    assert stopped == ["dark"]  # else the next try finds a busy device
    stops = iter([False, True])
    seen = WatchedCamera("oak", lambda: BadFrame(0, 0, "x"), lambda: None, lambda: next(stops))
    assert len(list(seen.frames())) == 1
