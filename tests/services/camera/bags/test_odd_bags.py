"""Bags with something odd in them: it costs the frames that it concerns, and an error names it."""

import errno
import gc
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionMode

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.reports import reports_of
from hsslam_node.sources.ros2.raw_image import RawImage
from hsslam_node.sources.source import BadFrame
from hsslam_services.camera.ros_frames import can_be_used
from tests.services.camera.bags.room_bags import ROOM, expect_same, opened, whole_frames
from tests.services.camera.bags.ros_bags import COLOR, DEPTH, INFO, KINDS, new_bag, written


@pytest.fixture(scope="module")
def room() -> list[Frame]:
    return whole_frames(open_source("synth:room", ROOM))


def test_a_stamp_before_0_is_a_bad_frame(room, tmp_path: Path):
    with new_bag(tmp_path / "bag", "mcap") as bag:
        bag.recorded_later_ns = 10**18
        for frame in room:
            bag.info(INFO, frame.stamp_ns, frame.camera)
            stamp_ns = -(10**9) if frame.index == 3 else frame.stamp_ns
            bag.image(COLOR, stamp_ns, frame.color, "rgb8")
            bag.image(DEPTH, stamp_ns, frame.depth_raw, "16UC1")
    bad = [item for item in opened(tmp_path / "bag").frames() if isinstance(item, BadFrame)]
    assert [item.reason for item in bad] == ["stamp before 1970: expected a time from 0 on"]


@pytest.mark.parametrize("kind", KINDS)
def test_frames_of_another_camera_info_are_bad(kind: str, room, tmp_path: Path):
    """As of a camera that zooms; the control differs by less than a pixel."""

    def write(name: str, fx: float) -> Path:
        path = tmp_path / (f"{name}.bag" if kind == "bag" else name)
        with new_bag(path, kind) as bag:
            for frame in room:
                zoomed = replace(frame.camera, fx=fx) if frame.index in (2, 3) else frame.camera
                bag.info(INFO, frame.stamp_ns, zoomed)
                bag.image(COLOR, frame.stamp_ns, frame.color, "rgb8")
                bag.image(DEPTH, frame.stamp_ns, frame.depth_raw, "16UC1")
        return path

    camera = room[0].camera
    items = list(opened(write("zooms", camera.fx + 50)).frames())
    bad = [item for item in items if isinstance(item, BadFrame)]
    assert [item.index for item in bad] == [2, 3]
    assert (
        f"camera_info changed to 160x120 with fx, fy, cx, cy = {camera.fx + 50:.1f}"
        in bad[0].reason
    )
    assert len(whole_frames(opened(write("steady", camera.fx + 0.5)))) == len(room)


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_a_bag_with_compressed_files_is_unpacked_once(kind, room, tmp_path: Path, monkeypatch):
    unpacked = tmp_path / "tmp"
    unpacked.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(unpacked))
    with new_bag(tmp_path / "bag", kind, CompressionMode.FILE) as bag:
        for frame in room:
            bag.frame(frame)
    source = opened(tmp_path / "bag", room[0].depth_units_per_m)
    (folder,) = unpacked.iterdir()
    expect_same(whole_frames(source), room)
    expect_same(whole_frames(source, first=4), room[4:])
    assert [*unpacked.iterdir()] == [folder]
    del source
    gc.collect()
    assert not [*unpacked.iterdir()]


def test_a_disk_too_full_to_unpack_a_bag_is_named(room, tmp_path: Path, monkeypatch):
    with new_bag(tmp_path / "bag", "db3", CompressionMode.FILE) as bag:
        bag.frame(room[0])

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/tmp/unpacked.db3")

    monkeypatch.setattr("rosbags.rosbag2.reader.TemporaryDirectory", full)
    with pytest.raises(UserError, match=r"expected room in \$TMPDIR, where compressed files"):
        opened(tmp_path / "bag", room[0].depth_units_per_m)


def _cut(path: Path) -> Path:
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    return path


def test_a_recording_that_was_cut_off_says_what_repairs_it(room, tmp_path: Path):
    folder = written(tmp_path, "mcap", room)
    (file,) = folder.glob("*.mcap")
    ros1 = _cut(written(tmp_path, "bag", room))
    active = tmp_path / "recorded.bag.active"
    active.write_bytes(ros1.read_bytes())
    of_ros1 = tmp_path / "ros1.mcap"
    with of_ros1.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="ros1")
        writer.finish()
    for path, words in (
        (
            _cut(file),
            "File end magic is invalid: expected .*: mcap recover FILE -o NEW.mcap",
        ),
        (folder, "File end magic is invalid: expected .*: mcap recover FILE -o NEW.mcap"),
        (active, "expected a .bag: rosbag reindex, then rename"),
        (of_ros1, "Profile is not ros2: expected messages of ROS 2, or the .bag of"),
        (ros1, "damaged: .*: rosbag reindex repairs"),
    ):
        with pytest.raises(UserError, match=f"source bag:{path}: cannot be read: .*{words}"):
            opened(path)


@pytest.mark.parametrize("unusable", [3, 30])
def test_intrinsics_of_0_before_the_right_ones_are_reported(unusable: int, room, tmp_path: Path):
    """As of a driver that starts; a `camera_info` comes ten times as often as images."""
    with new_bag(tmp_path / "bag", "mcap") as bag:
        for frame in room:
            for k in range(10):
                unknown = 10 * frame.index + k < unusable
                K = np.zeros((3, 3)) if unknown else frame.camera.K
                bag.intrinsics(INFO, frame.stamp_ns + k, frame.camera, K)
            bag.image(COLOR, frame.stamp_ns, frame.color, "rgb8")
            bag.image(DEPTH, frame.stamp_ns, frame.depth_raw, "16UC1")
    if unusable == 30:  # of the first thirty none is right
        with pytest.raises(
            UserError, match=rf"source bag:.*bag: {INFO}: camera.fx = 0.0: expected"
        ):
            opened(tmp_path / "bag")
        return
    source = opened(tmp_path / "bag", room[0].depth_units_per_m)
    expect_same(whole_frames(source), room)
    (report,) = reports_of(source).take()
    assert report.text.count(INFO) == 1 and "source bag:" not in report.text


def test_millimetres_in_floats_with_their_scale_are_usable_from_the_first_pair():
    mm = np.full((120, 160), 3000.0, np.float32)
    depth = RawImage(0, "32FC1", mm.view(np.uint8).ravel(), 160, 120, 4 * 160)
    color = RawImage(0, "rgb8", np.zeros(3 * 160 * 120, np.uint8), 160, 120, 3 * 160)
    assert can_be_used((color, depth), None, None, 1000.0)
    assert not can_be_used((color, depth), None, None, None)


def test_an_encoding_that_is_not_supported_is_named(room, tmp_path: Path):
    with new_bag(tmp_path / "bag", "mcap") as bag:
        bag.info(INFO, 0, room[0].camera)
        bag.image(COLOR, 5, room[0].color, "rgb16")
        bag.image(DEPTH, 5, room[0].depth_raw, "16UC1")
    with pytest.raises(
        UserError, match=r"no topics for color: .*encoding 'rgb16', which is not su"
    ):
        opened(tmp_path / "bag")


def test_names_of_bags(room, tmp_path: Path):
    whole = written(tmp_path, "bag", room)
    upper = whole.rename(tmp_path / "UPPER.BAG")
    folder = written(tmp_path, "mcap", room).rename(tmp_path / "ros2.bag")
    for path in (upper, folder):
        expect_same(whole_frames(opened(path, room[0].depth_units_per_m)), room)


def test_depth_that_is_recorded_late_has_its_colour(room, tmp_path: Path):
    """The control has depth of other times, and says so."""
    frames = [replace(room[k % len(room)], index=k, stamp_ns=33_000_000 * k) for k in range(40)]
    for name, depth_lag_ns in (("late", 0), ("other", 500_000_000)):
        with new_bag(tmp_path / name, "mcap") as bag:
            for frame in frames:
                bag.recorded_later_ns = 0
                bag.info(INFO, frame.stamp_ns, frame.camera)
                bag.image(COLOR, frame.stamp_ns, frame.color, "rgb8")
                bag.recorded_later_ns = 900_000_000 - depth_lag_ns
                bag.image(DEPTH, frame.stamp_ns + depth_lag_ns, frame.depth_raw, "16UC1")
    late, other = opened(tmp_path / "late"), opened(tmp_path / "other")
    assert (late.frame_count, reports_of(late).take()) == (40, [])
    (report,) = reports_of(other).take()
    assert (
        f"{COLOR}: only {other.frame_count} of 40 images have one of 40 depth images" in report.text
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("kept_bytes", [4, 60])
@pytest.mark.parametrize("at", [0, 3])
def test_a_message_that_is_cut_off_costs_its_frame(kind: str, kept_bytes, at, room, tmp_path: Path):
    path = tmp_path / ("cut.bag" if kind == "bag" else "cut")
    with new_bag(path, kind) as bag:
        for frame in room:
            bag.info(INFO, frame.stamp_ns, frame.camera)
            bag.kept_bytes = kept_bytes if frame.index == at else None
            bag.image(COLOR, frame.stamp_ns, frame.color, "rgb8")
            bag.kept_bytes = None
            bag.image(DEPTH, frame.stamp_ns, frame.depth_raw, "16UC1")
    items = list(opened(path, room[0].depth_units_per_m).frames())
    expect_same(
        [item for item in items if isinstance(item, Frame)], [f for f in room if f.index != at]
    )
    (bad,) = (item for item in items if isinstance(item, BadFrame))
    assert bad.index == at and "no sensor_msgs/msg/Image in" in bad.reason


def test_a_first_image_of_another_size_is_a_bad_frame(room, tmp_path: Path):
    with new_bag(tmp_path / "bag", "mcap") as bag:
        for frame in room:
            part = slice(None, 80 if frame.index == 0 else None)
            bag.info(INFO, frame.stamp_ns, frame.camera)
            bag.image(COLOR, frame.stamp_ns, frame.color[part, part], "rgb8")
            bag.image(DEPTH, frame.stamp_ns, frame.depth_raw[part, part], "16UC1")
    items = list(opened(tmp_path / "bag").frames())
    assert [isinstance(item, BadFrame) for item in items] == [k == 0 for k in range(6)]


@pytest.mark.parametrize(
    ("color", "is_rectified"),
    [
        ("/camera_direct/image_raw", False),
        ("/camera/image_rect_color", True),
        ("/left_rect/image", True),
        ("/camera/rectified/image", True),
    ],
)
def test_images_are_rectified_if_a_word_of_their_topic_says_so(color, is_rectified, room, tmp_path):
    lens = (0.3, -0.1, 0.0, 0.0, 0.0)
    with new_bag(tmp_path / "bag", "mcap") as bag:
        bag.info(INFO, 0, replace(room[0].camera, distortion=lens))
        bag.image(color, 5, room[0].color, "rgb8")
        bag.image(DEPTH, 5, room[0].depth_raw, "16UC1")
    (frame,) = whole_frames(opened(tmp_path / "bag"))
    assert np.array_equal(frame.color, room[0].color) == is_rectified
    assert frame.camera.fx == (2 if is_rectified else 1) * room[0].camera.fx  # of P, or of K


_RAW, _RECT = "/camera/rgb/image_raw", "/camera/rgb/image_rect_color"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("color", "depth", "k1", "told"),
    [
        (_RAW, "/camera/depth_registered/image_rect", 0.3, "is removed from both"),
        (
            _RAW,
            "/camera/depth_registered/hw_registered/image_rect_raw",
            0.3,
            "is removed from both",
        ),
        (_RECT, "/camera/depth_registered/image_raw", 0.3, "stays in depth"),
        (_RAW, "/camera/depth_registered/image_rect", 0.0, ""),
        (_RECT, "/camera/depth_registered/image_raw", 0.0, ""),
        (_RAW, "/camera/depth_registered/image_raw", 0.3, ""),
        (_RECT, "/camera/depth_registered/image_rect", 0.3, ""),
        (COLOR, DEPTH, 0.3, ""),
    ],
)
def test_a_lens_in_only_one_of_colour_and_depth_is_told(
    kind: str, color, depth, k1, told, room, tmp_path
):
    path = tmp_path / ("lens.bag" if kind == "bag" else "lens")
    with new_bag(path, kind) as bag:
        bag.info(INFO, 0, replace(room[0].camera, distortion=(k1, -k1 / 3, 0.0, 0.0, 0.0)))
        bag.image(color, 5, room[0].color, "rgb8")
        bag.image(depth, 5, room[0].depth_raw, "16UC1")
    source = opened(path)
    reports = reports_of(source).take()
    assert len(whole_frames(source)) == 1
    assert [report.kind for report in reports] == [
        "only one of colour and depth is rectified"
    ] * bool(told)
    for report in reports:
        assert color in report.text and depth in report.text
        assert f"camera_info {told}; expected" in report.text
        assert report.text.endswith("(--bag.color, --bag.depth)")


@pytest.mark.parametrize("kind", KINDS)
def test_compressed_images_of_another_size_are_bad_frames(kind: str, room, tmp_path: Path):
    """Of formats whose headers are not read, and turned ones; a lens must not hide it."""
    path = tmp_path / ("sizes.bag" if kind == "bag" else "sizes")
    with new_bag(path, kind) as bag:
        bag.info(INFO, 0, replace(room[0].camera, distortion=(0.2, -0.1, 0.0, 0.0, 0.0)))
        for frame in room:
            part = slice(None, None, 2 if frame.index == 2 else 1)
            pixels = frame.color[part, part]
            pixels = np.swapaxes(pixels, 0, 1) if frame.index == 4 else pixels
            data = cv2.imencode(".bmp", np.ascontiguousarray(pixels[..., ::-1]))[1].ravel()
            bag.file(f"{COLOR}/compressed", frame.stamp_ns, data, "bmp")
            bag.image(DEPTH, frame.stamp_ns, frame.depth_raw, "16UC1")
    bad = [item for item in opened(path).frames() if isinstance(item, BadFrame)]
    assert [item.index for item in bad] == [2, 4]
    assert bad[0].reason == "colour of 80x60 pixels: expected 160x120 as before"


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_compressed_messages_need_the_folder_that_says_so(kind: str, room, tmp_path: Path):
    with new_bag(tmp_path / "bag", kind, CompressionMode.MESSAGE) as bag:
        for frame in room:
            bag.frame(frame)
    assert len(whole_frames(opened(tmp_path / "bag"))) == len(room)
    (part,) = (tmp_path / "bag").glob(f"*.{kind}")
    with pytest.raises(UserError, match=rf"{DEPTH}: .*name the folder with metadata.yaml"):
        opened(part)


@pytest.mark.parametrize("name", ["drive.bag", "drive.mcap", "drive.db3"])
def test_a_bag_on_a_disk_that_fails_is_one_line(tmp_path: Path, name: str):
    (tmp_path / name).symlink_to("/proc/self/mem")  # its first byte is an input/output error
    with pytest.raises(UserError, match=r"Input/output error|disk I/O error"):
        opened(tmp_path / name)
