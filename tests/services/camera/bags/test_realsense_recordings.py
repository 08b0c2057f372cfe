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


def _write(bag: BagWriter, room: list[Seen], depth_topic: str = _DEPTH_TOPIC) -> None:
    """The topics of a RealSense in ROS without align_depth."""
    for number, seen in enumerate(room):
        stamp_ns = 1 + 33_000_000 * number
        bag.info(INFO, stamp_ns, COLOR)
        bag.info(depth_topic.rpartition("/")[0] + "/camera_info", stamp_ns, DEPTH, scale=1.0)
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


def test_equal_cameras_that_sit_apart_are_registered_too(room, tmp_path: Path):
    """The control is aligned by its name: it stays as it is."""
    twin = [replace(seen, color=seen.color) for seen in room]
    for name, topic in (("apart", _DEPTH_TOPIC), ("aligned", ALIGNED_TOPIC)):
        with new_bag(tmp_path / name, "mcap") as bag:
            _mount(bag)
            for number, seen in enumerate(twin):
                bag.info(INFO, 1 + number, DEPTH)
                bag.info(topic.rpartition("/")[0] + "/camera_info", 1 + number, DEPTH, scale=1.0)
                bag.image(COLOR_TOPIC, 1 + number, seen.color, "rgb8", frame_id="color_optical")
                bag.image(topic, 1 + number, seen.depth_raw, "16UC1", frame_id="depth_optical")
    apart, aligned = (opened(tmp_path / name) for name in ("apart", "aligned"))
    assert len(reports_of(apart).take()) == 1 and not reports_of(aligned).take()
    for moved, kept, seen in zip(whole_frames(apart), whole_frames(aligned), room, strict=True):
        np.testing.assert_array_equal(kept.depth_raw, seen.depth_raw)
        assert np.mean(moved.depth_raw != seen.depth_raw) > 0.5


def test_depth_of_another_size_than_its_camera_is_a_bad_frame(room, tmp_path: Path):
    cut = [replace(s, depth_raw=s.depth_raw[: 60 if k == 1 else 120]) for k, s in enumerate(room)]
    with new_bag(tmp_path / "bag", "mcap") as bag:
        _mount(bag)
        _write(bag, cut)
    items = list(opened(tmp_path / "bag").frames())
    assert [isinstance(item, BadFrame) for item in items] == [False, True, False]
    assert items[1].reason == "16UC1 of 160x60 pixels: expected 160x120 as before"


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
