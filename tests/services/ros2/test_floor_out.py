"""Distances are asked of the run only while a node of ROS wants them."""

import numpy as np

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.ros2.floor_out import FloorOut
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.node import RosNode
from tests.services.ros2.ros_listener import RosListener
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
