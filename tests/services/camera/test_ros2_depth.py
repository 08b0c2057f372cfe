"""A ROS 2 camera whose depth is not aligned to colour, over real zenoh sessions."""

import itertools
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.sources.reports import reports_of
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.names import Qos
from hsslam_services.ros2.node import RosNode
from tests.node.sources.files.two_cameras import (
    COLOR,
    DEPTH,
    T_COLOR_DEPTH,
    Seen,
    expect_registered,
    seen_room,
)
from tests.services.camera.ros_camera import (
    FIRST_NS,
    RosCamera,
    camera_info,
    header,
    image,
    ros2_options,
)

_UNITS_PER_M = 1000.0
_DEPTH = "depth/image_raw"
_COLOR_FRAME, _DEPTH_FRAME = "camera_color_optical_frame", "camera_depth_optical_frame"


@pytest.fixture(scope="module")
def seen() -> Seen:
    return seen_room(_UNITS_PER_M, rows=(40,))[0]


@contextmanager
def _showing(
    ros_camera: RosCamera, seen: Seen, depth_raw: np.ndarray, frame_id: str = _DEPTH_FRAME
) -> Iterator[None]:
    """Publishes both images and their intrinsics until it is left."""
    ended = threading.Event()

    def publish() -> None:
        for k in itertools.count():
            if ended.wait(0.02):
                return
            stamp_ns = FIRST_NS + k * 20_000_000
            depth = image(stamp_ns, depth_raw, "16UC1")
            depth.header = header(stamp_ns, frame_id)
            for topic, message, kind in (
                ("color/camera_info", camera_info(stamp_ns, COLOR), "CameraInfo"),
                ("color/image_raw", image(stamp_ns, seen.color, "rgb8"), "Image"),
                (_DEPTH, depth, "Image"),
                ("depth/camera_info", camera_info(stamp_ns, DEPTH), "CameraInfo"),
            ):
                ros_camera.put(f"/camera/{topic}", message, kind)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_depth_is_registered_by_tf_static(endpoint, ros_camera, seen):
    messages = RosMessages("kilted")
    with RosNode(endpoint, 0, "/robot", "state", messages) as node:
        latched = node.publisher("/tf_static", "tf2_msgs/msg/TFMessage", Qos(1, is_latched=True))
        of_color = ("camera_link", _COLOR_FRAME, inverse(T_COLOR_DEPTH))
        latched.put(messages.transforms(1, [of_color, ("camera_link", _DEPTH_FRAME, np.eye(4))]))
        with _showing(ros_camera, seen, seen.depth_raw):
            source = open_any_source("ros2:/camera", ros2_options(endpoint, 3, depth=_DEPTH))
            frames = [frame for frame in source.frames() if isinstance(frame, Frame)]
    assert len(frames) == 3 and source.camera == COLOR
    assert (
        "its camera is 14.8 mm from that of /camera/color/image_raw"
        in reports_of(source).take()[0].text
    )
    for frame in frames:
        expect_registered(frame.depth_raw, seen.exact, _UNITS_PER_M)


def test_depth_of_the_frame_of_colour_is_not_moved_whatever_its_intrinsics_say(
    endpoint, ros_camera, seen
):
    with _showing(ros_camera, seen, seen.depth_raw, _COLOR_FRAME):
        source = open_any_source("ros2:/camera", ros2_options(endpoint, 2, depth=_DEPTH))
        frames = [frame for frame in source.frames() if isinstance(frame, Frame)]
    assert len(frames) == 2 and not reports_of(source).take()
    for frame in frames:
        np.testing.assert_array_equal(frame.depth_raw, seen.depth_raw)


@pytest.mark.parametrize("rows", [120, 60])  # of depth: as many as colour has, and fewer
def test_without_tf_static_it_is_one_line(endpoint, ros_camera, seen, rows):
    asked = ros2_options(endpoint, 3, depth=_DEPTH, timeout_s=1.0)
    words = rf"/depth/image_raw has 160x120 pixels .*: expected .* from {_DEPTH_FRAME} to {_COLOR_FRAME} on"
    with _showing(ros_camera, seen, seen.depth_raw[:rows]), pytest.raises(UserError, match=words):
        open_any_source("ros2:/camera", asked)
