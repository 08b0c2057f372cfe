"""A node that publishes every kind of message, and one of ROS that hears it."""

import time

import numpy as np
import pytest

from hsslam_node.geometry.se3 import se3_exp
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.names import Qos
from hsslam_services.ros2.node import RosNode, RosPublisher
from tests.services.ros2.ros_listener import RosListener, gid_of

STAMP_NS = 1_700_000_000_123_456_789
T = se3_exp(np.array([1.0, 2.0, 3.0, 0.1, -0.2, 0.3]))
COVARIANCE = np.diag([1e-4, 2e-4, 3e-4, 4e-4, 5e-4, 6e-4])
_MESSAGES = RosMessages("test")


@pytest.fixture
def listener(endpoint):
    listener = RosListener(endpoint)
    yield listener
    listener.close()


@pytest.fixture
def node(endpoint):
    with RosNode(endpoint, 0, "/hsslam", "slam", _MESSAGES) as node:
        yield node


def _grid() -> np.ndarray:
    return np.array([[0, 100, -1], [50, -1, 0]], np.int8)


def _each() -> list:
    m = _MESSAGES
    cloud = m.cloud(
        STAMP_NS, "camera", np.array([[1, 2, 3], [4, 5, 6]], np.float32),
        np.array([[255, 1, 2], [3, 4, 5]], np.uint8),
    )  # fmt: skip
    distances = np.array([[0.5, np.nan], [1.5, 2.0], [0.0, -0.1]])
    return [
        m.pose(STAMP_NS, "map", T, COVARIANCE),
        m.odometry(STAMP_NS, ("base_link", "odom"), T, COVARIANCE, np.arange(6.0), None),
        m.path(STAMP_NS, "map", [STAMP_NS, STAMP_NS + 5], np.stack([T, np.eye(4)])),
        m.transforms(STAMP_NS, [("map", "odom", T), ("odom", "base_link", np.eye(4))]),
        cloud,
        m.occupancy_grid(STAMP_NS, "map", 0.05, T, _grid()),
        m.distance_slice(STAMP_NS, "map", 0.1, np.array([-1.0, -2.0, 0.3]), distances, 1000.0),
    ]


def _wait_for_subscribers(publisher: RosPublisher) -> None:
    deadline_s = time.monotonic() + 30
    while not publisher.has_subscribers():
        assert time.monotonic() < deadline_s
        time.sleep(0.005)


def test_every_kind_is_read_by_others(node, listener):
    for number, message in enumerate(_each()):
        topic = f"t{number}"
        listener.hear(f"/hsslam/{topic}")
        publisher = node.publisher(topic, message.__msgtype__, Qos(10))
        _wait_for_subscribers(publisher)
        publisher.put(message)
    listener.wait_until(lambda: sum(listener.count(f"/hsslam/t{n}") for n in range(7)) == 7)
    found = sorted(listener.heard(), key=lambda one: one.topic)
    pose, odometry, path, transforms, cloud, grid, slice_ = (one.by_pycdr2 for one in found)
    for message in (pose, odometry, path, cloud, grid, slice_, transforms.transforms[0]):
        stamp = message.header.stamp
        assert (stamp.sec, stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert pose.header.frame_id == "map" and pose.pose.pose.position.z == T[2, 3]
    covariance = np.reshape(pose.pose.covariance, (6, 6))
    np.testing.assert_allclose(covariance, COVARIANCE, atol=2e-8)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert odometry.twist.twist.linear.y == 1.0 and odometry.twist.twist.angular.x == 3.0
    unknown = np.reshape(odometry.twist.covariance, (6, 6))
    np.testing.assert_array_equal(unknown, 1e6 * np.eye(6))
    assert [p.header.stamp.nanosec for p in path.poses] == [123_456_789, 123_456_794]
    assert [t.child_frame_id for t in transforms.transforms] == ["odom", "base_link"]
    points = np.frombuffer(bytes(cloud.data), "<f4").reshape(2, 4)
    np.testing.assert_array_equal(points[:, :3], [[1, 2, 3], [4, 5, 6]])
    assert bytes(cloud.data)[12:16] == bytes(
        [2, 1, 255, 0]
    )  # blue first: rgb in a little endian word
    assert (cloud.width, cloud.height, cloud.point_step, cloud.row_step) == (2, 1, 16, 32)
    assert (grid.info.width, grid.info.height, list(grid.data)) == (3, 2, [0, 100, -1, 50, -1, 0])
    assert (slice_.width, slice_.height, slice_.origin.z) == (2, 3, 0.3)
    np.testing.assert_allclose(slice_.data, [0.5, 1000, 1.5, 2.0, 0.0, -0.1], rtol=1e-6)
    for one in found:
        assert one.sequence == 1 and one.stamp_ns > STAMP_NS
        assert one.gid == gid_of(one.topic, listener.tokens())


def test_the_graph_shows_the_node_as_long_as_it_lives(endpoint, listener):
    with RosNode(endpoint, 0, "/hsslam", "slam", _MESSAGES) as node:
        node.publisher("map", "nav_msgs/msg/OccupancyGrid", Qos(1, is_latched=True))
        listener.wait_until(lambda: listener.alive() == 2)
        kinds = {token.split("/")[5] for token in listener.tokens()}
        assert kinds == {"NN", "MP"}
        (token,) = (token for token in listener.tokens() if "/MP/" in token)
        assert token.split("/")[8:10] == ["slam", "%hsslam%map"]
        assert token.endswith("/:1:,1:,:,:,,")
    listener.wait_until(lambda: listener.alive() == 0)


def test_a_late_subscriber_gets_the_last_map(node, listener):
    publisher = node.publisher("map", "nav_msgs/msg/OccupancyGrid", Qos(1, is_latched=True))
    for cell_m in (0.1, 0.05):
        grid = _MESSAGES.occupancy_grid(STAMP_NS, "map", cell_m, T, _grid())
        publisher.put(grid)
    listener.hear_latched("/hsslam/map")
    # perhaps after the first, which was still on its way
    listener.wait_until(lambda: any(one.sequence == 2 for one in listener.heard()))
    assert abs(listener.heard()[-1].by_rosbags.info.resolution - 0.05) < 1e-6
