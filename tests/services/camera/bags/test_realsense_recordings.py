"""Depth that is not aligned to colour: recordings by the RealSense SDK itself, and bags with `/tf_static`."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import inverse
from hsslam_node.sources.reports import reports_of
from hsslam_node.sources.source import BadFrame
from hsslam_services.camera.bags.realsense_image import image_without_unit
from tests.node.sources.files.two_cameras import (
    COLOR,
    DEPTH,
    T_COLOR_DEPTH,
    Seen,
    expect_registered,
    seen_room,
)
from tests.services.camera.bags.recorded.record import UNITS_PER_M
from tests.services.camera.bags.room_bags import opened, whole_frames
from tests.services.camera.bags.ros_bags import COLOR as COLOR_TOPIC
from tests.services.camera.bags.ros_bags import DEPTH as ALIGNED_TOPIC
from tests.services.camera.bags.ros_bags import INFO, KINDS, BagWriter, new_bag

_RECORDED = Path(__file__).with_name("recorded")
_DEPTH_TOPIC, _DEPTH_INFO = "/camera/depth/image_rect_raw", "/camera/depth/camera_info"
_UNITS_PER_M = 1000.0
_STREAM = "/device_0/sensor_0/Depth_0"


@pytest.fixture(scope="module")
def room() -> list[Seen]:
    return seen_room(_UNITS_PER_M)


def _numbers(T: np.ndarray) -> list[float]:
    return [*T[:3, 3].tolist(), *Rotation.from_matrix(T[:3, :3]).as_quat().tolist()]


def _write(
    bag: BagWriter, room: list[Seen], depth_topic: str = _DEPTH_TOPIC, scale: float = 1.0
) -> None:
    """The topics of a RealSense in ROS without align_depth."""
    for number, seen in enumerate(room):
        stamp_ns = 1 + 33_000_000 * number
        bag.info(INFO, stamp_ns, COLOR)
        bag.info(depth_topic.rpartition("/")[0] + "/camera_info", stamp_ns, DEPTH, scale=scale)
        bag.image(COLOR_TOPIC, stamp_ns, seen.color, "rgb8", frame_id="color_optical")
        bag.image(depth_topic, stamp_ns, seen.depth_raw, "16UC1", frame_id="depth_optical")


def _mount(bag: BagWriter) -> None:
    """Both optical frames, in a link between them."""
    T_link_color = inverse(T_COLOR_DEPTH)
    of = [
        ("link", "color_optical", _numbers(T_link_color)),
        ("link", "depth_optical", [0.0] * 6 + [1.0]),
    ]
    bag.static_transforms(1, of)


@pytest.mark.parametrize("name", ["viewer.bag", "viewer.db3"])
def test_a_recording_of_the_realsense_sdk(name: str):
    units_per_m = UNITS_PER_M[name]
    source = opened(_RECORDED / name)
    assert (source.camera, source.depth_units_per_m) == (COLOR, units_per_m)
    (report,) = reports_of(source).take()
    assert "its camera is 14.8 mm from that of /device_0/sensor_1/Color_0" in report.text
    frames = whole_frames(source)
    for frame, seen in zip(frames, seen_room(units_per_m), strict=True):
        assert np.abs(frame.color.astype(int) - seen.color).max() <= 1
        expect_registered(frame.depth_raw, seen.exact, units_per_m)


@pytest.mark.parametrize("kind", KINDS)
def test_the_mounting_is_on_tf_static(kind: str, room, tmp_path: Path):
    path = tmp_path / ("apart.bag" if kind == "bag" else "apart")
    with new_bag(path, kind) as bag:
        _mount(bag)
        _write(bag, room)
    source = opened(path)
    assert f"{_DEPTH_TOPIC}: its camera is 14.8 mm" in reports_of(source).take()[0].text
    for frame, seen in zip(whole_frames(source), room, strict=True):
        expect_registered(frame.depth_raw, seen.exact, _UNITS_PER_M)


def test_without_a_mounting_it_is_one_line(room, tmp_path: Path):
    with new_bag(tmp_path / "bag", "mcap") as bag:
        _write(bag, room)
    with pytest.raises(UserError) as caught:
        opened(tmp_path / "bag")
    text = str(caught.value)
    assert f"{_DEPTH_TOPIC} has 160x120 pixels and fx, fy, cx, cy = 96.2, 96.2, 79.0, 59.8" in text
    assert text.endswith(
        "align_depth.enable:=true), or a transform from depth_optical to color_optical on /tf_static"
    )
    assert "\n" not in text


def test_depth_with_the_intrinsics_of_colour_counts_as_registered(room, tmp_path: Path):
    """Some drivers give registered depth the frame of the depth camera; it is reported."""
    with new_bag(tmp_path / "bag", "mcap") as bag:
        _mount(bag)
        for number, seen in enumerate(room):
            bag.info(INFO, 1 + number, DEPTH)
            bag.info(_DEPTH_INFO, 1 + number, DEPTH, scale=1.0)
            bag.image(COLOR_TOPIC, 1 + number, seen.color, "rgb8", frame_id="color_optical")
            bag.image(_DEPTH_TOPIC, 1 + number, seen.depth_raw, "16UC1", frame_id="depth_optical")
    source = opened(tmp_path / "bag")
    (report,) = reports_of(source).take()
    assert report.text.startswith(f"{_DEPTH_TOPIC}: frame_id depth_optical: expected color_optical")
    for frame, seen in zip(whole_frames(source), room, strict=True):
        np.testing.assert_array_equal(frame.depth_raw, seen.depth_raw)


def test_depth_that_is_aligned_by_its_name_is_not_moved(room, tmp_path: Path):
    with new_bag(tmp_path / "bag", "mcap") as bag:
        _mount(bag)
        _write(bag, room, ALIGNED_TOPIC)
    with pytest.raises(
        UserError, match=r"expected depth that is registered to colour as its name says"
    ):
        opened(tmp_path / "bag")


@pytest.mark.parametrize("kind", KINDS)
def test_intrinsics_of_rectified_depth_may_lack_P(kind: str, room, tmp_path: Path):
    path = tmp_path / ("bag.bag" if kind == "bag" else "bag")
    with new_bag(path, kind) as bag:
        _mount(bag)
        _write(bag, room, scale=0.0)
    expect_registered(whole_frames(opened(path))[0].depth_raw, room[0].exact, _UNITS_PER_M)


def test_depth_of_another_size_than_its_camera_is_a_bad_frame(room, tmp_path: Path):
    cut = [replace(s, depth_raw=s.depth_raw[: 60 if k == 1 else 120]) for k, s in enumerate(room)]
    with new_bag(tmp_path / "bag", "mcap") as bag:
        _mount(bag)
        _write(bag, cut)
    items = list(opened(tmp_path / "bag").frames())
    assert [isinstance(item, BadFrame) for item in items] == [False, True, False]
    assert items[1].reason == "16UC1 of 160x60 pixels: expected 160x120 as before"


def test_of_two_depth_topics_the_unaligned_one_is_not_taken(room, tmp_path: Path):
    """As of Orbbec cameras."""
    with new_bag(tmp_path / "bag", "mcap") as bag:
        for number, seen in enumerate(room):
            bag.info(INFO, 1 + number, COLOR)
            bag.image(COLOR_TOPIC, 1 + number, seen.color, "rgb8")
            bag.image("/camera/depth/image_raw", 1 + number, seen.exact, "16UC1")
            bag.image("/camera/depth/image_unaligned", 1 + number, seen.depth_raw, "16UC1")
    for frame, seen in zip(whole_frames(opened(tmp_path / "bag")), room, strict=True):
        np.testing.assert_array_equal(frame.depth_raw, seen.exact)


def test_a_frame_that_looks_another_way_is_named(room, tmp_path: Path):
    """The body frame, x ahead, in the place of the optical one."""
    with new_bag(tmp_path / "bag", "mcap") as bag:
        of_body = ("color_optical", "depth_optical", [0.01, 0.0, 0.0, 0.5, -0.5, 0.5, 0.5])
        bag.static_transforms(1, [of_body])
        _write(bag, room)
    words = r"frame_id depth_optical looks another way than that of .*, color_optical, by /tf_static: ex"
    with pytest.raises(UserError, match=words):
        opened(tmp_path / "bag")


def test_depth_of_another_frame_without_intrinsics_is_reported(room, tmp_path: Path):
    with new_bag(tmp_path / "bag", "mcap") as bag:
        for number, seen in enumerate(room):
            bag.info(INFO, 1 + number, COLOR)
            bag.image(COLOR_TOPIC, 1 + number, seen.color, "rgb8", frame_id="color_optical")
            bag.image(_DEPTH_TOPIC, 1 + number, seen.depth_raw, "16UC1", frame_id="depth_optical")
    (report,) = reports_of(opened(tmp_path / "bag")).take()
    assert "frame_id depth_optical: expected color_optical as colour, if depth is" in report.text


@pytest.mark.parametrize("of_depth", [True, False])
def test_registered_depth_of_which_one_topic_is_rectified_goes_on(of_depth, room, tmp_path: Path):
    """One camera, whose P differs from K: colour and depth have the same `camera_info`."""
    lens = replace(COLOR, distortion=(0.3, -0.1, 0.0, 0.0, 0.0))
    color, depth = ("rgb/image_raw", "depth_registered/image_rect")
    if not of_depth:
        color, depth = ("rgb/image_rect_color", "depth_registered/image_raw")
    with new_bag(tmp_path / "bag", "mcap") as bag:
        for topic in (color, depth):
            bag.info(f"/{topic.rpartition('/')[0]}/camera_info", 1, lens)
        bag.image(f"/{color}", 5, room[0].color, "rgb8")
        bag.image(f"/{depth}", 5, room[0].depth_raw, "16UC1")
    source = opened(tmp_path / "bag")
    (report,) = reports_of(source).take()
    assert "is rectified by its name" in report.text and len(whole_frames(source)) == 1


@pytest.mark.parametrize(("kind", "kept_bytes"), [("bag", 2), ("db3", 6)])
def test_a_unit_that_is_cut_off_is_one_line(kind, kept_bytes, room, tmp_path: Path):
    path = tmp_path / ("viewer.bag" if kind == "bag" else "viewer")
    with new_bag(path, kind) as bag:
        for stream, camera in ((_STREAM, COLOR), ("/device_0/sensor_1/Color_0", COLOR)):
            bag.info(f"{stream}/info/camera_info", 1, camera)
        bag.image(f"{_STREAM}/image/data", 5, room[0].depth_raw, "mono16")
        bag.image("/device_0/sensor_1/Color_0/image/data", 5, room[0].color, "rgb8")
        bag.kept_bytes = kept_bytes
        bag.number("/device_0/sensor_0/option/Depth_Units/value", 1, 0.001)
    with pytest.raises(UserError, match=r"Depth_0/image/data: unit: no std_msgs/msg/Float32 in"):
        opened(path)


def test_a_mounting_that_is_not_valid_is_named(room, tmp_path: Path):
    with new_bag(tmp_path / "viewer.bag", "bag") as bag:
        for stream, camera in ((_STREAM, DEPTH), ("/device_0/sensor_1/Color_0", COLOR)):
            bag.info(f"{stream}/info/camera_info", 1, camera)
            bag.transform(f"{stream}/tf/1", 1, [0.0] * 7)
        bag.image(f"{_STREAM}/image/data", 5, room[0].depth_raw, "mono16")
        bag.image("/device_0/sensor_1/Color_0/image/data", 5, room[0].color, "rgb8")
    with pytest.raises(
        UserError, match=r"Depth_0/image/data: mounting of the camera: 0 0 .*a unit q"
    ):
        opened(tmp_path / "viewer.bag")


@given(payload=st.binary(max_size=80), lengths=st.tuples(*[st.integers(0, 20)] * 3))
def test_an_image_ends_where_its_pixels_end(payload: bytes, lengths):
    """Of bytes that are no image, nothing is cut but what could be the unit."""
    assert payload.startswith(image_without_unit(payload))
    frame_id, encoding, pixels = (struct.pack("<I", n) + n * b"x" for n in lengths)
    image = 12 * b"\0" + frame_id + 8 * b"\1" + encoding + 5 * b"\0" + pixels
    assert image_without_unit(image) == image
    assert image_without_unit(image + struct.pack("<f", 0.001)) == image
