"""A ROS camera whose intrinsics or lens change: its frames are bad until they are as at first."""

from dataclasses import replace
from itertools import islice

from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source import BadFrame
from hsslam_services.camera.open_source import open_any_source
from tests.services.camera.bags.room_bags import ROOM, whole_frames
from tests.services.camera.ros_camera import ros2_options

_MOST_FRAMES = 300


def test_frames_are_bad_while_the_camera_zooms(endpoint, ros_camera):
    room = whole_frames(open_source("synth:room", ROOM))
    ros_camera.start(room)
    source = open_any_source("ros2:/camera", ros2_options(endpoint))
    items = source.frames()
    for zoomed_px, kind in ((0.0, Frame), (50.0, BadFrame), (0.4, Frame)):
        ros_camera.info = replace(room[0].camera, fx=room[0].camera.fx + zoomed_px)
        found = next(item for item in islice(items, _MOST_FRAMES) if type(item) is kind)
        if isinstance(found, BadFrame):
            assert (
                f"camera_info changed to 160x120 with fx, fy, cx, cy = {room[0].camera.fx + 50:.1f}"
                in found.reason
            )
    items.close()


def test_frames_are_bad_while_the_camera_has_another_lens(endpoint, ros_camera):
    room = whole_frames(open_source("synth:room", ROOM))
    first = replace(room[0].camera, distortion=(0.1, 0.0, 0.0, 0.0, 0.0))
    ros_camera.start(room, camera=first)
    source = open_any_source("ros2:/camera", ros2_options(endpoint))
    items = source.frames()
    for k1, now, kind in (
        (0.1, "", Frame),
        (0.2, "0.2, 0, 0, 0, 0", BadFrame),
        (0.1004, "", Frame),
        (0.0, "", BadFrame),
    ):
        ros_camera.info = replace(first, distortion=(k1, 0.0, 0.0, 0.0, 0.0))
        found = next(item for item in islice(items, _MOST_FRAMES) if type(item) is kind)
        if isinstance(found, BadFrame):
            assert (
                f"camera_info changed to lens model opencv with coefficients [{now}]: expected "
                "lens model opencv with coefficients [0.1, 0, 0, 0, 0] as at first" in found.reason
            )
    items.close()
