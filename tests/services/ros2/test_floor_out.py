"""Distances are asked of the run only while a node of ROS wants them."""

from collections.abc import Iterator

import numpy as np
import pytest

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.ros2.floor_out import FloorOut
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.node import RosNode
from tests.services.ros2.ros_listener import RosListener
from tests.services.wire_samples import grid
from tests.until import until


@pytest.fixture
def distances(endpoint: str) -> Iterator[Bus]:
    """The bus of the process that publishes the grid and slices."""
    with Bus(endpoint, "r", "distances") as bus:
        yield bus


@pytest.fixture
def ros2_out(endpoint: str) -> Iterator[Bus]:
    with Bus(endpoint, "r", "ros2_out") as bus:
        yield bus


@pytest.fixture
def out(endpoint: str, ros2_out: Bus) -> Iterator[FloorOut]:
    messages = RosMessages("test")
    with RosNode(endpoint, 0, "/hsslam", "slam", messages) as node:
        yield FloorOut(ros2_out, node, messages, "map", has_ros_stamps=False)


def test_slices_are_asked_for_while_a_node_subscribes_to_them(endpoint, distances, ros2_out, out):
    slices = distances.publisher(topics.ESDF)

    def is_asked() -> bool:
        out.tell_news(np.eye(4))
        return slices.has_subscribers()

    assert not is_asked()
    before = ros2_out.subscriptions
    listener = RosListener(endpoint)
    listener.hear("/hsslam/static_map_slice")
    until(is_asked, 60)
    listener.close()
    until(lambda: not is_asked(), 60)
    assert ros2_out.subscriptions == before  # each heartbeat reads their counters


def test_a_map_that_is_given_up_is_unknown(endpoint, distances, out):
    grids = distances.publisher(topics.GRID)
    listener = RosListener(endpoint)
    listener.hear("/hsslam/map")

    def known() -> list[bool]:
        """Whether cells are known in each grid that was heard."""
        out.tell_news(np.eye(4))
        return [bool((m.by_rosbags.data >= 0).any()) for m in listener.heard("/hsslam/map")]

    out.forget(np.eye(4))  # nothing was there
    grids.put(grid(0))
    until(lambda: known() == [True], 60)
    out.forget(np.eye(4))
    until(lambda: known() == [True, False], 60)
    size = [(m.by_rosbags.info.width, m.by_rosbags.info.height) for m in listener.heard()]
    assert size[0] == size[1]
    listener.close()
