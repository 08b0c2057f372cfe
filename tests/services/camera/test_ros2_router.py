"""The router of ROS nodes is started after a camera that needs it, or never."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_services.bus.bus import free_endpoint, open_router
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.ros2 import listening_session
from tests.services.camera.ros_camera import RosCamera, ros2_options

_SOON_S = 5.0  # less than the 10 s that a session waits for a router by itself


@pytest.fixture
def brief_tries(monkeypatch) -> None:
    monkeypatch.setattr(listening_session, "_CONNECT_S", 0.1)


def test_a_router_that_starts_later_is_waited_for(room, brief_tries):
    endpoint = free_endpoint()
    with ThreadPoolExecutor(1) as thread:
        opening = thread.submit(open_any_source, "ros2:/camera", ros2_options(endpoint, 3))
        time.sleep(0.5)
        assert not opening.done()
        with closing(open_router(endpoint)), closing(RosCamera(endpoint)) as camera:
            camera.start(room)
            frames = list(opening.result().frames())
    assert len(frames) == 3 and all(isinstance(frame, Frame) for frame in frames)


def test_it_is_waited_for_as_long_as_is_asked(brief_tries):
    begin_s = time.monotonic()
    with pytest.raises(UserError, match=r"a router .*: tried for 0\.3 s \(--ros2\.timeout-s\)"):
        open_any_source("ros2:/camera", ros2_options(free_endpoint(), timeout_s=0.3))
    assert 0.3 < time.monotonic() - begin_s < _SOON_S


def test_who_waits_for_it_can_be_stopped():
    stopped = threading.Event()
    threading.Timer(0.2, stopped.set).start()
    begin_s = time.monotonic()
    with pytest.raises(UserError, match="ros2:/camera: stopped before the first frame"):
        options = ros2_options(free_endpoint(), timeout_s=60.0)
        open_any_source("ros2:/camera", options, stopped.is_set)
    assert time.monotonic() - begin_s < _SOON_S
