"""A camera of ROS 2, and what it shows unless a test has frames of its own."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from tests.services.camera.bags.room_bags import ROOM, whole_frames
from tests.services.camera.ros_camera import RosCamera


@pytest.fixture(scope="module")
def room() -> list[Frame]:
    return whole_frames(open_source("synth:room", replace(ROOM, frames=12)))


@pytest.fixture
def ros_camera(endpoint: str) -> Iterator[RosCamera]:
    camera = RosCamera(endpoint)
    yield camera
    camera.close()
