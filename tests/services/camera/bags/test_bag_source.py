"""Bags as a source: the frames that were written come back, of each kind of bag."""

from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.camera import CameraOptions
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.topics import BagOptions
from hsslam_node.sources.reports import reports_of
from hsslam_node.sources.source import BadFrame
from hsslam_services.camera.bags.bag_file import BagFile, BagMessage
from hsslam_services.camera.open_source import check_source_exists, open_any_source
from hsslam_services.run.options import ServeOptions
from tests.late_frames import expect_late_frames_left_out
from tests.services.camera.bags.room_bags import ROOM, expect_same, opened, whole_frames
from tests.services.camera.bags.ros_bags import (
    COLOR,
    DEPTH,
    INFO,
    KINDS,
    BagWriter,
    new_bag,
    written,
)


@pytest.fixture(scope="module")
def room() -> list[Frame]:
    return whole_frames(open_source("synth:room", ROOM))


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_those_that_were_written(kind: str, room: list[Frame], tmp_path: Path):
    units = room[0].depth_units_per_m
    path = written(tmp_path, kind, room, depth_lag_ns=4_000_000)
    source = opened(path, units)
    assert (source.frame_count, source.camera) == (6, room[0].camera)
    assert source.rate_hz == pytest.approx(30, rel=1e-6)
    expect_same(whole_frames(source), room)
    expect_same(whole_frames(source, first=4), room[4:])
    chosen = opened(path, units, start=1, stride=2, frames=2)
    assert chosen.frame_count == 2
    expect_same(whole_frames(chosen), [replace(room[k], index=n) for n, k in enumerate((1, 3))])
    expect_same(whole_frames(chosen, first=1), [replace(room[3], index=1)])


def test_opening_reads_to_the_last_selected_frame(room, tmp_path: Path, monkeypatch):
    path, units = written(tmp_path, "db3", room), room[0].depth_units_per_m
    read: list[str] = []
    messages = BagFile.messages

    def counted(bag: BagFile, topics: Collection[str]) -> Iterator[BagMessage]:
        for message in messages(bag, topics):
            read.append(message.topic)
            yield message

    monkeypatch.setattr(BagFile, "messages", counted)
    for options, frames, depths in (
        ({}, 6, 6),
        ({"frames": 1}, 1, 1),
        ({"start": 1, "stride": 2, "frames": 2}, 2, 4),
    ):
        read.clear()
        source = opened(path, units, **options)
        assert source.frame_count == frames
        assert read.count(DEPTH) == depths + 1  # one shows the encoding
        assert not reports_of(source).take()
    read.clear()
    check_source_exists(ServeOptions(f"bag:{path}"))
    assert read.count(DEPTH) == 2
    with pytest.raises(UserError, match=r"--start 6: source bag:.* has 6 frames"):
        opened(path, units, start=6, frames=1)


@pytest.mark.parametrize("kind", KINDS)
def test_the_real_kitchen_comes_back_as_from_its_folder(kind: str, test_data, tmp_path: Path):
    kitchen = whole_frames(
        open_source(f"tum:{test_data / 'kitchen'}", SourceOptions(start=100, frames=5))
    )
    path = written(tmp_path, kind, kitchen)
    expect_same(whole_frames(opened(path, kitchen[0].depth_units_per_m)), kitchen)


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_the_file_in_a_folder_of_ros2_is_a_bag_of_its_own(kind: str, room, tmp_path: Path):
    (file,) = written(tmp_path, kind, room).glob(f"*.{kind}")
    expect_same(whole_frames(opened(file, room[0].depth_units_per_m)), room)


@pytest.mark.parametrize("kind", KINDS)
def test_the_lens_is_taken_out(kind: str, room, tmp_path: Path):
    path = written(tmp_path, kind, room[:1], distortion=(0.2, -0.1, 0.0, 0.0, 0.0))
    (frame,) = whole_frames(opened(path))
    assert frame.camera == room[0].camera
    assert frame.depth_raw[0, 0] == 0  # no pixel of the lens is there


def test_compressed_images_and_depth_in_metres(room, tmp_path: Path):
    with new_bag(tmp_path / "files", "mcap") as bag, new_bag(tmp_path / "metres", "mcap") as metres:
        for frame in room:
            bag.info(INFO, frame.stamp_ns, frame.camera)
            color = cv2.imencode(".png", frame.color[..., ::-1])[1]
            bag.file(f"{COLOR}/compressed", frame.stamp_ns, color, "rgb8; png compressed bgr8")
            depth = np.concatenate(
                [np.zeros(12, np.uint8), cv2.imencode(".png", frame.depth_raw)[1]]
            )
            bag.file(
                f"{DEPTH}/compressedDepth", frame.stamp_ns, depth, "16UC1; compressedDepth png"
            )
            metres.info(INFO, frame.stamp_ns, frame.camera)
            metres.image(COLOR, frame.stamp_ns, frame.color, "rgb8")
            metres.image(DEPTH, frame.stamp_ns, frame.depth_m(), "32FC1")
    units = room[0].depth_units_per_m
    expect_same(whole_frames(opened(tmp_path / "files", units)), room)
    for found, frame in zip(whole_frames(opened(tmp_path / "metres")), room, strict=True):
        np.testing.assert_allclose(found.depth_m(), frame.depth_m(), atol=1.1e-4)
    for scale in (1.0, 2.0):  # units of the floats per metre
        first = whole_frames(opened(tmp_path / "metres", scale))[0]
        np.testing.assert_allclose(first.depth_m(), room[0].depth_m() / scale, atol=1.1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_topics_are_named_if_several_fit(kind: str, room, tmp_path: Path):
    def more(bag: BagWriter) -> None:
        bag.image("/left/image_raw", 5, room[0].color, "rgb8")
        bag.image("/infra/image_raw", 5, room[0].color[..., 0], "mono8")
        bag.image("/camera/depth/image_rect_raw", 5, room[0].depth_raw, "16UC1")

    path = written(tmp_path, kind, room, more)
    with pytest.raises(UserError) as caught:
        opened(path)
    text = str(caught.value)
    assert (
        f"2 topics for color ({COLOR}, /left/image_raw): expected one, or its name as --bag.color"
        in text
    )
    for topic in (f"{COLOR} (Image)", f"{INFO} (CameraInfo)", "/infra/image_raw (Image)"):
        assert topic in text
    units = room[0].depth_units_per_m
    expect_same(whole_frames(opened(path, units, bag=BagOptions(color=COLOR))), room)
    with pytest.raises(UserError, match=r"--bag\.depth /nothing: no such topic: expected one"):
        opened(path, bag=BagOptions(color=COLOR, depth="/nothing"))


def test_topics_that_are_missing(room, tmp_path: Path):
    with new_bag(tmp_path / "a", "mcap") as bag:
        bag.image(COLOR, 5, room[0].color, "rgb8")
    with pytest.raises(UserError, match=f"no topics for depth: .*; topics: {COLOR} \\(Image\\)"):
        opened(tmp_path / "a")
    with new_bag(tmp_path / "b", "mcap") as bag:
        bag.image(COLOR, 5, room[0].color, "rgb8")
        bag.image(DEPTH, 5, room[0].depth_raw, "16UC1")
    with pytest.raises(
        UserError, match=r"no topics for info: expected one, or .*--bag\.info TOPIC"
    ):
        opened(tmp_path / "b")
    path = written(tmp_path, "mcap", room, depth_lag_ns=16_500_000)
    with pytest.raises(
        UserError, match=r"they are 16\.5 ms apart: expected at most 16, or --bag\.max-dt-ms"
    ):
        opened(path, bag=BagOptions(max_dt_ms=16.0))
    unlimited = opened(path)
    assert len(whole_frames(unlimited)) == 6
    reports = reports_of(unlimited).take()
    assert {report.kind for report in reports} == {"colour and depth far apart"}
    assert "16 ms between colour and depth of a frame" in reports[0].text
    assert opened(path, bag=BagOptions(max_dt_ms=16.6)).frame_count == 6
    with pytest.raises(UserError, match=r"--start 6: source bag:.* has 6 frames"):
        opened(path, start=6, bag=BagOptions(max_dt_ms=16.6))


def test_a_realsense_recording_whose_depth_is_not_registered(room, tmp_path: Path):
    """The layout of Intel's viewer; the control has the intrinsics of colour for depth."""
    camera, sensors = room[0].camera, ("/device_0/sensor_0/Depth_0", "/device_0/sensor_1/Color_0")
    for name, of_depth in (("own.bag", replace(camera, fx=100.0)), ("same.bag", camera)):
        with new_bag(tmp_path / name, "bag") as bag:
            bag.info(f"{sensors[0]}/info/camera_info", 1, of_depth)
            bag.info(f"{sensors[1]}/info/camera_info", 1, camera)
            for frame in room:
                bag.image(f"{sensors[0]}/image/data", frame.stamp_ns, frame.depth_raw, "mono16")
                bag.image(f"{sensors[1]}/image/data", frame.stamp_ns, frame.color, "rgb8")
    with pytest.raises(
        UserError,
        match=r"Depth_0/image/data has 160x120 pixels and fx, .*: expected depth that is regis",
    ):
        opened(tmp_path / "own.bag")
    expect_same(whole_frames(opened(tmp_path / "same.bag", room[0].depth_units_per_m)), room)


def test_an_image_that_cannot_be_decoded_is_a_bad_frame(room, tmp_path: Path):
    with new_bag(tmp_path / "files", "db3") as bag:
        bag.info(INFO, 0, room[0].camera)
        for frame in room:
            color = cv2.imencode(".png", frame.color[..., ::-1])[1]
            kept = color[:200] if frame.index == 3 else color
            bag.file(f"{COLOR}/compressed", frame.stamp_ns, kept, "png")
            bag.image(DEPTH, frame.stamp_ns, frame.depth_raw, "16UC1")
    items = list(opened(tmp_path / "files").frames())
    assert [isinstance(item, BadFrame) for item in items] == [k == 3 for k in range(6)]
    assert [(item.index, item.stamp_ns) for item in items] == [(f.index, f.stamp_ns) for f in room]


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_bag_is_one_line(kind: str, room, tmp_path: Path):
    path = written(tmp_path, kind, room)
    file = path if kind == "bag" else next(path.glob(f"*.{kind}"))
    whole = file.read_bytes()
    for kept in (0, 10, 1000, len(whole) // 2, len(whole) - 100):
        file.write_bytes(whole[:kept])
        with pytest.raises(
            UserError, match=r"source bag:.*cannot be read: .*: expected a whole"
        ) as caught:
            opened(path)
        assert "\n" not in str(caught.value)
    rng = np.random.default_rng(0)
    for _ in range(12):  # zeros in the middle: told, or images that show something else
        damaged = bytearray(whole)
        at = int(rng.integers(0, len(whole) - 400))
        damaged[at : at + 400] = bytes(400)
        file.write_bytes(damaged)
        try:
            assert len(list(opened(path).frames())) <= len(room)
        except UserError as error:
            assert "\n" not in str(error)


def test_the_camera_of_a_bag_is_its_own_but_for_the_scale_of_depth(room, tmp_path: Path):
    path = written(tmp_path, KINDS[0], room)
    expected = (
        "--camera.fx 9.0: source bag:.* has its own camera: expected only --camera.depth-scale"
    )
    with pytest.raises(UserError, match=expected):
        open_any_source(f"bag:{path}", SourceOptions(camera=CameraOptions(fx=9.0)))
    assert opened(path, 2000.0).depth_units_per_m == 2000.0


def test_what_is_no_bag(tmp_path: Path):
    with pytest.raises(
        UserError, match=r"source bag:/no/bag: no such file: expected a folder with metad"
    ):
        open_any_source("bag:/no/bag")
    with pytest.raises(UserError, match=r"no metadata\.yaml in it: expected a bag of ROS 2"):
        open_any_source(f"bag:{tmp_path}")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: [1")
    with pytest.raises(UserError, match="Could not load YAML"):
        open_any_source(f"bag:{tmp_path}")
    with pytest.raises(UserError, match=r"--bag\.color 'a b': expected the name of a topic"):
        BagOptions(color="a b")
    with pytest.raises(UserError, match=r"--bag\.max-dt-ms -1: expected 0 to 1000"):
        BagOptions(max_dt_ms=-1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("only_ns", [0, 10**9])
def test_headers_of_one_stamp_have_the_times_of_the_recording(kind, only_ns, room, tmp_path: Path):
    path = tmp_path / ("a.bag" if kind == "bag" else "a")
    with new_bag(path, kind) as bag:
        for frame in room:
            bag.recorded_later_ns = 10**18 + frame.stamp_ns - only_ns
            bag.odometry("/odom", only_ns, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            bag.frame(replace(frame, stamp_ns=only_ns))
    frames = whole_frames(opened(path, bag=BagOptions(odometry="/odom")))
    assert [frame.stamp_ns for frame in frames] == [10**18 + frame.stamp_ns for frame in room]
    assert all(frame.odometry is not None for frame in frames)


def test_the_only_frame_keeps_its_stamp(room, tmp_path: Path):
    path = tmp_path / "bag"
    with new_bag(path, "mcap") as bag:
        bag.recorded_later_ns = 10**18
        bag.frame(room[5])
    assert [frame.stamp_ns for frame in whole_frames(opened(path))] == [room[5].stamp_ns]


def test_only_all_stamps_of_a_topic_that_are_0_are_none(room, tmp_path: Path):
    """As of a simulator whose clock begins at 0, recorded by the wall clock."""
    with new_bag(tmp_path / "bag", "mcap") as bag:
        bag.recorded_later_ns = 10**18
        for frame in room:
            bag.frame(frame)
    assert room[0].stamp_ns == 0
    stamps = [frame.stamp_ns for frame in whole_frames(opened(tmp_path / "bag"))]
    assert stamps == [frame.stamp_ns for frame in room]


def test_broken_images_at_the_beginning_are_bad_frames(room, tmp_path: Path):
    def write(name: str, broken: int) -> Path:
        with new_bag(tmp_path / name, "mcap") as bag:
            bag.info(INFO, 0, room[0].camera)
            for frame in room:
                color = cv2.imencode(".jpg", frame.color[..., ::-1])[1]
                kept = color[: len(color) // 2] if frame.index < broken else color
                bag.file(f"{COLOR}/compressed", frame.stamp_ns, kept, "jpeg")
                bag.image(DEPTH, frame.stamp_ns, frame.depth_raw, "16UC1")
        return tmp_path / name

    items = list(opened(write("two", 2)).frames())
    assert [isinstance(item, BadFrame) for item in items] == [k < 2 for k in range(6)]
    with pytest.raises(UserError, match=r"source bag:.*: image in format 'jpeg': truncated at"):
        opened(write("all", 6))


def test_images_of_late_frames_are_not_decoded(room: list[Frame], tmp_path: Path):
    path = written(tmp_path, KINDS[0], room)
    expect_late_frames_left_out(opened(path, room[0].depth_units_per_m, start=1))
