"""Messages encoded by pycdr2, decoded by ours."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_services.camera.ros2_messages import CdrMessages
from tests.services.camera.ros_camera import (
    CompressedImage,
    RegionOfInterest,
    camera_info,
    header,
    image,
)

STAMP_NS = 1_700_000_000_123_456_789
PIXELS = np.random.default_rng(0).integers(0, 256, (6, 5, 3)).astype(np.uint8)
CAMERA = Camera(640, 480, 525.0, 526.0, 319.0, 241.0, (0.1, -0.2, 0.001, 0.002, 0.3))
CDR = CdrMessages()


def test_an_image():
    found = CDR.image(image(STAMP_NS, PIXELS, "rgb8").serialize(), "sensor_msgs/msg/Image")
    assert found.stamp_ns == STAMP_NS
    np.testing.assert_array_equal(found.color(), PIXELS)


def test_a_compressed_image():
    message = CompressedImage(header(STAMP_NS), "jpeg", b"\xff\xd8 not all of it")
    found = CDR.image(message.serialize(), "sensor_msgs/msg/CompressedImage")
    assert (found.stamp_ns, found.encoding, found.is_compressed) == (STAMP_NS, "jpeg", True)
    assert found.data.tobytes() == b"\xff\xd8 not all of it"


def test_a_camera():
    payload = camera_info(STAMP_NS, CAMERA).serialize()
    kind = "sensor_msgs/msg/CameraInfo"
    assert CDR.camera(payload, kind, is_rectified=False) == CAMERA
    rectified = CDR.camera(payload, kind, is_rectified=True)
    assert rectified == replace(CAMERA, fx=1050.0, fy=1052.0, distortion=())


def test_a_camera_whose_driver_bins_pixels_and_cuts_out_a_region():
    info, kind = camera_info(STAMP_NS, CAMERA), "sensor_msgs/msg/CameraInfo"
    info.binning_x, info.binning_y = 2, 4
    found = CDR.camera(info.serialize(), kind, is_rectified=False)
    lens = CAMERA.distortion
    assert found == Camera(320, 120, 262.5, 131.5, 159.5, 60.25, lens)
    info.roi = RegionOfInterest(19, 41, 400, 200, False)  # x, y, height, width
    found = CDR.camera(info.serialize(), kind, is_rectified=False)
    assert found == Camera(100, 100, 262.5, 131.5, 150.0, 50.0, lens)
    rectified = CDR.camera(info.serialize(), kind, is_rectified=True)
    assert rectified == Camera(100, 100, 525.0, 263.0, 150.0, 50.0)


@pytest.mark.parametrize(
    ("name", "lens", "kept", "model"),
    [
        ("plumb_bob", (0.0, 0.0, 0.0, 0.0, 0.0), 0, "opencv"),
        ("plumb_bob", (0.1, 0.0, 0.0, 0.0), 4, "opencv"),
        ("rational_polynomial", (0.1, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0), 5, "opencv"),
        ("rational_polynomial", (0.1, 0.0, 0.0, 0.0, 0.2, 0.5, 0.0, 0.0), 8, "opencv"),
        ("rational_polynomial", (0.1, 0.0, 0.0, 0.0, 0.2, *[0.5] * 9), 14, "opencv"),
        ("equidistant", (0.1, 0.2, 0.3, 0.4), 4, "equidistant"),
        ("equidistant", (0.1, 0.2, 0.3, 0.4, 0.0), 4, "equidistant"),
        ("equidistant", (0.0, 0.0, 0.0, 0.0), 0, "opencv"),  # as image_geometry of ROS takes it
    ],
)
def test_lenses(name, lens, kept, model):
    info = camera_info(0, CAMERA, name)
    info.d = list(lens)
    camera = CDR.camera(info.serialize(), "sensor_msgs/msg/CameraInfo", is_rectified=False)
    assert (camera.distortion, camera.distortion_model) == (lens[:kept], model)


@pytest.mark.parametrize(
    ("name", "lens", "words"),
    [
        (
            "fov",
            (0.9,),
            r"distortion_model = 'fov': expected plumb_bob, rational_polynomial, equid",
        ),
        ("plumb_bob", (0.1, 0.0, 0.0), r"camera_info\.d = .*\(3 numbers\): expected 0 or 4 or 5"),
        ("equidistant", (0.1, 0.2), r"camera_info\.d = \[0\.1, 0\.2\] .*: expected 4 numbers"),
    ],
)
def test_a_lens_that_is_not_known_is_named(name, lens, words):
    info = camera_info(0, CAMERA, name)
    info.d = list(lens)
    with pytest.raises(UserError, match=words):
        CDR.camera(info.serialize(), "sensor_msgs/msg/CameraInfo", is_rectified=False)


def test_whatever_is_no_message_is_told():
    whole = image(STAMP_NS, PIXELS, "rgb8").serialize()
    rng = np.random.default_rng(0)
    for payload in [whole[:n] for n in range(0, len(whole), 7)] + [
        rng.bytes(80) for _ in range(50)
    ]:
        with pytest.raises(BadImageError, match="no sensor_msgs/msg/Image in CDR"):
            CDR.image(payload, "sensor_msgs/msg/Image")
    for _ in range(
        300
    ):  # bytes changed: told, or an image that does not fit or shows something else
        changed = bytearray(whole)
        changed[rng.integers(4, 60)] = rng.integers(256)
        with contextlib.suppress(BadImageError):
            CDR.image(bytes(changed), "sensor_msgs/msg/Image").color()
    with pytest.raises(BadImageError, match="type std_msgs/msg/String: expected"):
        CDR.image(whole, "std_msgs/msg/String")
