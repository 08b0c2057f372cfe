"""A camera of ROS 2 over real zenoh sessions, its messages written by another CDR library."""

import itertools
import json
import threading
import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Report, reports_of
from hsslam_node.sources.source import BadFrame, NoFrame
from hsslam_services.bus.bus import free_endpoint
from hsslam_services.camera import ros2_source
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.commands.doctor import main as doctor
from hsslam_services.ros2 import listening_session
from tests.services.camera.ros_camera import (
    FIRST_NS,
    CompressedImage,
    RosCamera,
    camera_info,
    header,
    image,
    odometry,
    ros2_options,
)
from tests.services.serve_process import QUICK


def test_frames_are_those_that_were_published(endpoint, ros_camera, room):
    ros_camera.start(room, depth_lag_ns=4_000_000)
    source = open_any_source("ros2:/camera", ros2_options(endpoint, 20))
    assert (source.camera, source.depth_units_per_m) == (room[0].camera, 1000.0)
    frames = list(source.frames())
    assert [frame.index for frame in frames] == list(range(20))
    seen = set()
    for frame in frames:
        assert isinstance(frame, Frame)
        k = round((frame.stamp_ns - FIRST_NS) * 30 / 1e9) % 22
        k = min(k, 22 - k)  # to and fro
        np.testing.assert_array_equal(frame.color, room[k].color)
        np.testing.assert_allclose(frame.depth_m(), room[k].depth_m(), atol=1.1e-3)
        seen.add(frame.stamp_ns)
    assert len(seen) == 20


def test_the_lens_is_taken_out(endpoint, ros_camera, room):
    lens = replace(room[0].camera, distortion=(0.2, -0.1, 0.0, 0.0, 0.0))
    ros_camera.start(room, camera=lens)
    source = open_any_source("ros2:/camera", ros2_options(endpoint, 1))
    assert source.camera == room[0].camera
    (frame,) = source.frames()
    assert isinstance(frame, Frame)
    assert frame.depth_raw[0, 0] == 0  # no pixel of the lens is there


@pytest.mark.parametrize(
    ("color", "depth", "k1", "told"),
    [
        ("image_raw", "depth_registered/image_rect", 0.2, "is removed from both"),
        ("image_rect_color", "depth_registered/image_raw", 0.2, "stays in depth"),
        ("image_raw", "depth_registered/image_rect", 0.0, ""),
        ("image_raw", "aligned_depth_to_color/image_raw", 0.2, ""),
    ],
)
def test_a_lens_in_only_one_of_colour_and_depth_is_told(endpoint, room, color, depth, k1, told):
    camera = RosCamera(
        endpoint, (f"/camera/rgb/{color}", f"/camera/{depth}", "/camera/rgb/camera_info")
    )
    camera.start(room, camera=replace(room[0].camera, distortion=(k1, -k1 / 2, 0.0, 0.0, 0.0)))
    try:
        options = ros2_options(endpoint, 1, color=f"rgb/{color}", depth=depth)
        source = open_any_source("ros2:/camera", options)
        assert all(isinstance(frame, Frame) for frame in source.frames())
    finally:
        camera.close()
    reports = reports_of(source).take()
    assert len(reports) == bool(told)
    for report in reports:
        assert all(topic in report.text for topic in camera.topics[:2])
        assert f"camera_info {told}; expected" in report.text
        assert report.text.endswith("(--ros2.color, --ros2.depth)")


def test_what_is_heard_is_said_where_nothing_fits(endpoint, ros_camera, room):
    ros_camera.start(room, depth_lag_ns=16_500_000)
    with pytest.raises(UserError) as error:
        open_any_source("ros2:/camera", ros2_options(endpoint, timeout_s=0.5, color="rgb/image"))
    assert "no camera_info within 0.5 s on /camera/rgb/image, " in str(error.value)
    assert "heard: /camera/aligned_depth_to_color/image_raw (Image), " in str(error.value)
    assert "/camera/color/camera_info (CameraInfo)" in str(error.value)
    with pytest.raises(
        UserError, match=r"depth are 16\.\d ms apart: expected at most 15 ms, or --ros2\.max-dt-ms"
    ):
        open_any_source("ros2:/camera", ros2_options(endpoint, timeout_s=0.5, max_dt_ms=15.0))
    remedy = r"\(nodes need RMW_IMPLEMENTATION=rmw_zenoh_cpp\)"
    with pytest.raises(UserError, match=f"heard: nothing in domain 7 {remedy}"):
        open_any_source("ros2:/camera", ros2_options(endpoint, timeout_s=0.1, domain=7))


@pytest.mark.parametrize(
    ("stamp_ns", "message"),
    [
        (5, "depth has 9x9 pixels: expected 160x120 as colour"),
        (
            0,
            r"no colour-depth pair .*; /camera/.*_raw: header.stamp is 0: expected the time of the",
        ),
    ],
)
def test_depth_that_is_not_registered_and_images_without_a_stamp(
    endpoint, ros_camera, room, stamp_ns, message
):
    def publish() -> None:
        while not ended.wait(0.02):
            info = camera_info(stamp_ns, room[0].camera)
            ros_camera.put("/camera/color/camera_info", info, "CameraInfo")
            ros_camera.put("/camera/color/image_raw", image(stamp_ns, room[0].color, "rgb8"))
            small = image(stamp_ns, np.ones((9, 9), np.uint16), "16UC1")
            ros_camera.put("/camera/aligned_depth_to_color/image_raw", small)

    ended = threading.Event()
    thread = threading.Thread(target=publish)
    thread.start()
    try:
        with pytest.raises(UserError, match=message):
            open_any_source("ros2:/camera", ros2_options(endpoint, timeout_s=3.0))
    finally:
        ended.set()
        thread.join()


def test_messages_that_are_none_and_silence_are_told_and_it_goes_on(
    endpoint, ros_camera, room, monkeypatch
):
    ros_camera.start(room)
    ended = threading.Event()
    source = open_any_source("ros2:/camera", ros2_options(endpoint), ended.is_set)
    frames = source.frames()
    assert all(isinstance(frame, Frame) for frame in itertools.islice(frames, 3))
    ros_camera.put("/camera/color/image_raw", b"\0\1\0\0 no image")
    told = next(item for item in frames if isinstance(item, BadFrame))
    assert told.reason.startswith("/camera/color/image_raw: no sensor_msgs/msg/Image in CDR")
    ros_camera.stop()
    monkeypatch.setattr(ros2_source, "_SILENCE_S", 0.3)
    told = next(item for item in frames if isinstance(item, BadFrame))
    assert isinstance(told, NoFrame)
    assert told.reason.startswith("no frame for 0.3 s: no images on /camera/color/image_raw and /")
    ended.set()
    assert list(itertools.islice(frames, 10)) == []


def test_images_that_cannot_be_used_are_no_silence(endpoint, ros_camera, room, monkeypatch):
    monkeypatch.setattr(ros2_source, "_SILENCE_S", 1.0)
    ros_camera.start(room)
    ended = threading.Event()
    frames = open_any_source("ros2:/camera", ros2_options(endpoint), ended.is_set).frames()
    assert isinstance(next(frames), Frame)
    ros_camera.stop()
    until_s = time.monotonic() + 2.5
    while time.monotonic() < until_s:
        ros_camera.put("/camera/color/image_raw", b"\0\1\0\0 no image")
        told = next(item for item in frames if isinstance(item, BadFrame))
        assert not isinstance(told, NoFrame), told.reason
    ended.set()
    assert list(frames) == []


def _put_each(
    camera: RosCamera, room: list[Frame], ended: threading.Event, color: Callable
) -> None:
    """Frames whose colour is what `color` makes of its JPEG and its number, with odometry."""
    for k in itertools.count():
        if ended.wait(0.02):
            return
        stamp_ns, frame = FIRST_NS + k * 33_333_333, room[k % len(room)]
        camera.put("/camera/color/camera_info", camera_info(stamp_ns, frame.camera), "CameraInfo")
        numbers = (0.0,) * 7 if k % 3 == 2 else (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        camera.put("/odom", odometry(stamp_ns, numbers), "Odometry")
        jpeg = cv2.imencode(".jpg", frame.color[..., ::-1])[1].tobytes()
        message = CompressedImage(header(stamp_ns), "jpeg", color(jpeg, k))
        camera.put("/camera/color/image_raw/compressed", message, "CompressedImage")
        depth = (frame.depth_m() * 1000).astype(np.uint16)
        camera.put("/camera/aligned_depth_to_color/image_raw", image(stamp_ns, depth, "16UC1"))


def _opened_of_jpegs(
    endpoint: str, camera: RosCamera, room: list[Frame], color: Callable[[bytes, int], bytes]
) -> tuple[list[Frame | BadFrame], list[Report]]:
    """30 frames, and what is told beside them."""
    ended = threading.Event()
    thread = threading.Timer(0.5, _put_each, (camera, room, ended, color))
    thread.start()
    try:
        name = "color/image_raw/compressed"
        asked = ros2_options(endpoint, 30, color=name, odometry="/odom")
        source = open_any_source("ros2:/camera", asked)
        return list(source.frames()), reports_of(source).take()
    finally:
        ended.set()
        thread.join()


def test_a_first_image_that_is_broken_and_odometry_that_is_none_cost_no_frame(
    endpoint, ros_camera, room
):
    items, reports = _opened_of_jpegs(
        endpoint, ros_camera, room, lambda jpeg, k: jpeg[: len(jpeg) // 2] if k < 20 else jpeg
    )
    assert sum(isinstance(item, Frame) for item in items) >= 27
    assert sum(isinstance(item, Frame) and item.odometry is not None for item in items) >= 25
    assert {report.kind for report in reports} == {"/odom: unusable messages"}
    assert len(reports) > 5


def test_images_that_are_all_broken_are_refused(endpoint, ros_camera, room):
    with pytest.raises(UserError, match=r"ros2:/camera: image in format 'jpeg': truncated at \d+"):
        _opened_of_jpegs(endpoint, ros_camera, room, lambda jpeg, k: jpeg[: len(jpeg) // 2])


@pytest.mark.parametrize("has_router", [True, False])
def test_the_doctor_looks_at_it(has_router, endpoint, room, tmp_path, capsys, monkeypatch):
    """Where ROS nodes look for a router; if none is there, the doctor is the one that they find."""
    place = endpoint if has_router else free_endpoint()
    monkeypatch.setattr(listening_session, "ROS_ROUTER", place)
    camera = RosCamera(place)
    camera.start(room)
    try:
        with pytest.raises(SystemExit) as done:
            args = ["ros2:/camera", "--sample-frames", "12"]
            doctor([*args, "--json", str(tmp_path / "found.json")])
    finally:
        camera.close()
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["frames_looked_at"] == 12
    rows = {finding["name"]: finding["severity"] for finding in found["findings"]}
    assert rows["images"] == rows["intrinsics"] == rows["depth coverage"] == "ok"
    assert done.value.code == bool(found["faults"])
    capsys.readouterr()


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("ros2:camera", "expected the camera's namespace"),
        ("ros2:", "did you mean ros2:/camera"),
    ],
)
def test_wrong_names(spec, words):
    with pytest.raises(UserError, match=words):
        open_any_source(spec, SourceOptions())


@pytest.mark.e2e
def test_a_run_whose_router_is_that_of_the_ros_nodes(serve, room, own_address):
    camera = RosCamera(f"tcp/{own_address}:7447")  # before there is a router
    camera.start(room, rate_hz=15)
    places = ("--zenoh-port", "7447", "--bind", own_address)
    run = serve("--source", "ros2:/camera", *places, *QUICK, "--frames", "40")
    try:
        assert run.finish() == 0, run.stderr
    finally:
        camera.close()
    assert run.summary()["stop_reason"] == "end of source"
    poses = read_tum(run.out / "trajectory.txt")
    assert len(poses.stamps_ns) >= 20
    assert (np.diff(poses.stamps_ns) > 0).all()
    assert 0 < poses.stamps_ns[0] - FIRST_NS < 600e9  # the camera's own clock
