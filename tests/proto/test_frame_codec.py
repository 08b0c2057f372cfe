import time
from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.odometry.reading import OdometryReading
from hsslam_proto import messages, topics
from hsslam_proto.codec import decode, encode, encoding_of
from hsslam_proto.frame_codec import frame_from_message, frame_message
from hsslam_proto.frame_order import new_publisher
from hsslam_services.log.frame_compression import compress_frame
from tests.claimed_image import png_that_claims


def test_raw_frames_come_back_equal():
    frame = _frame()
    back = frame_from_message(frame_message(frame, stamp_ns=99))
    assert back.stamp_ns == frame.stamp_ns
    assert back.camera == frame.camera
    np.testing.assert_array_equal(back.color, frame.color)
    np.testing.assert_array_equal(back.depth_raw, frame.depth_raw)


def test_odometry_of_another_camera_or_series_is_of_another_series():
    reading = OdometryReading.at(np.eye(4), np.zeros((6, 6)), series=new_publisher())
    of_one = replace(_frame(), odometry=reading)
    cameras = (new_publisher(), new_publisher())

    def series(frame: Frame, camera: int, attached: int = 0) -> int:
        found = frame_from_message(frame_message(frame, 99, camera), attached).odometry
        assert found is not None
        return found.series

    again = replace(of_one, odometry=replace(reading, series=new_publisher()))
    assert series(of_one, cameras[0]) == series(of_one, cameras[0])
    assert series(of_one, cameras[0]) != series(again, cameras[0])
    assert series(of_one, cameras[0]) != series(of_one, cameras[1])
    assert series(of_one, 0, cameras[0]) != series(of_one, 0, cameras[1])
    assert series(of_one, 0) == reading.series


def test_compressed_frames_are_read():
    frame = _frame()
    message = frame_message(frame, stamp_ns=99)
    jpeg = cv2.imencode(".jpg", frame.color[..., ::-1])[1].tobytes()
    png = cv2.imencode(".png", frame.depth_raw)[1].tobytes()
    message = msgspec.structs.replace(
        message,
        color=memoryview(jpeg),
        color_encoding="jpeg",
        depth=memoryview(png),
        depth_encoding="png",
    )
    back = frame_from_message(message)
    np.testing.assert_array_equal(back.depth_raw, frame.depth_raw)
    assert np.abs(back.color.astype(int) - frame.color).mean() < 12


def test_images_out_of_a_payload_suit_compiled_kernels():
    for fill in range(8):  # shifts the images within the payload
        message = msgspec.structs.replace(frame_message(_frame(), 1), index=10**fill)
        payload = encode(topics.FRAME, message)
        decoded = decode(topics.FRAME, payload, encoding_of(topics.FRAME))
        assert isinstance(decoded, messages.Frame)
        frame = frame_from_message(decoded)
        for image in (frame.color, frame.depth_raw):
            assert image.flags.aligned and image.flags.writeable and image.flags.c_contiguous


@pytest.mark.parametrize("field", ["color", "depth"])
@pytest.mark.parametrize("data", [b"", b"no image"])
def test_unreadable_images_are_told(field, data):
    encoding = {"color": "jpeg", "depth": "png"}[field]
    message = msgspec.structs.replace(
        frame_message(_frame(), 1), **{field: memoryview(data), f"{field}_encoding": encoding}
    )
    with pytest.raises(UserError, match=f"in/frame 7: {field} is unreadable"):
        frame_from_message(message)


@pytest.mark.parametrize("field", ["color", "depth"])
@pytest.mark.parametrize("width, height, bits, kind", [(16384, 16384, 1, 0), (61, 40, 16, 0)])
def test_images_of_another_size_are_refused_by_their_header(field, width, height, bits, kind):
    data = png_that_claims(width, height, bits, kind)
    message = msgspec.structs.replace(
        frame_message(_frame(), 1), **{field: memoryview(data), f"{field}_encoding": "png"}
    )
    begin_s = time.process_time()
    for read in (frame_from_message, compress_frame):
        with pytest.raises(UserError, match=f"{field} is a PNG of {width}x{height}.*of 60x40"):
            read(message)
    assert time.process_time() - begin_s < 0.2  # 16384 x 16384 take 0.6 s and 0.8 GB


def _frame() -> Frame:
    ramp = np.linspace(0, 255, 40)[:, None] * np.ones((1, 60))
    color = np.stack([ramp, ramp[::-1], ramp * 0.5], axis=-1).astype(np.uint8)
    depth = np.random.default_rng(0).integers(0, 20_000, (40, 60), dtype=np.uint16)
    return Frame(7, 123, Camera(60, 40, 50.0, 50.0, 29.5, 19.5), color, depth, 5000.0)
