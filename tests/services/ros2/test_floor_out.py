"""Distances are asked of the run only while a node of ROS wants them."""

import numpy as np

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.ros2.floor_out import FloorOut
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.node import RosNode
from tests.services.ros2.ros_listener import RosListener
from tests.services.wire_samples import grid
from tests.until import until


def test_slices_are_asked_for_while_a_node_subscribes_to_them(endpoint):
    messages = RosMessages("test")
    with (
        Bus(endpoint, "r", "distances") as run,
        Bus(endpoint, "r", "ros2_out") as bus,
        RosNode(endpoint, 0, "/hsslam", "slam", messages) as node,
    ):
        slices = run.publisher(topics.ESDF)
        out = FloorOut(bus, node, messages, "map", has_ros_stamps=False)

        def is_asked() -> bool:
            out.tell_news(np.eye(4))
            return slices.has_subscribers()

        assert not is_asked()
        before = bus.subscriptions
        listener = RosListener(endpoint)
        listener.hear("/hsslam/static_map_slice")
        until(is_asked, 60)
        listener.close()
        until(lambda: not is_asked(), 60)
        assert bus.subscriptions == before  # each heartbeat reads their counters


def test_a_map_that_is_given_up_is_unknown(endpoint):
    messages = RosMessages("test")
    with (
        Bus(endpoint, "r", "distances") as run,
        Bus(endpoint, "r", "ros2_out") as bus,
        RosNode(endpoint, 0, "/hsslam", "slam", messages) as node,
    ):
        grids = run.publisher(topics.GRID)
        out = FloorOut(bus, node, messages, "map", has_ros_stamps=False)
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
