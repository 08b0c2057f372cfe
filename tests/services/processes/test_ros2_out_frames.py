"""What ROS 2 hears of single frames, told without a run."""

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from hsslam_node.geometry.se3 import transform
from hsslam_node.map.pose_log import TRACKED, PoseLog, pose_row
from hsslam_node.map.store import KeyframeStore
from hsslam_proto import topics
from hsslam_proto.messages import Pose
from hsslam_proto.pose_codec import wire_covariance
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.ros2_out import Ros2Out
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.node import RosNode
from tests.services.ros2.ros_listener import RosListener
from tests.services.wire_samples import frame, pose
from tests.small_room import room_frames
from tests.until import until

_FRAME_NS = 33_333_333


class _Node:
    """A node that is told of poses, and a node of ROS that hears it."""

    def __init__(self, worker: Worker, node: RosNode, listener: RosListener) -> None:
        self._worker = worker
        self._out = Ros2Out(worker, node, RosMessages("test"))
        self.listener = listener
        self._index = 0

    def tell(self, sees: Callable[[Pose], None] | None = None, **fields: object) -> int:
        """Tell of the next frame, 10 cm to the right, shown before by `sees`; returns its stamp, ns.

        The clock of ROS runs twice as fast as that of the source.
        """
        self._index += 1
        stamp_ns = 10**18 + 2 * self._index * _FRAME_NS
        known = {
            "stamp_ns": stamp_ns,
            "odometry": [0.1 * self._index, 0, 0, 0, 0, 0, 1],
            "covariance": wire_covariance(1e-4 * np.eye(6)),
        }
        told = msgspec.structs.replace(pose(self._index), **{**known, **fields})
        if sees is not None:
            sees(told)
        self._out.tell(told)
        return stamp_ns

    def received(self) -> int:
        """Frames, since the node subscribes to them; -1: not yet."""
        return (
            sum(one.received for one in self._worker.bus.subscriptions)
            if self._worker.bus.subscriptions
            else -1
        )


@pytest.fixture
def run(make_run):
    options = {"ros2_out": "/hsslam", "ros2_frame_prefix": "one/"}
    return replace(make_run(**options), supervisor_pid=os.getppid())


@pytest.fixture
def worker(run) -> Iterator[Worker]:
    with Worker("ros2_out", run) as worker:
        yield worker


@pytest.fixture
def node(run, worker) -> Iterator[_Node]:
    listener = RosListener(run.endpoint)
    with RosNode(run.endpoint, 0, "/hsslam", "slam", RosMessages("test")) as ros:
        yield _Node(worker, ros, listener)
    listener.close()


def test_a_camera_that_sees_nothing_publishes_no_points(run, node):
    """Without any a collision monitor stops the robot; an empty cloud says that its way is free."""
    node.listener.hear("/hsslam/points")
    until(lambda: node.tell() and node.received() >= 0, 60)
    with Bus(run.endpoint, run.robot, "camera") as camera:
        frames = camera.publisher(topics.FRAME, block=True)
        until(frames.has_subscribers, 60)

        def show(of: Pose, depth: int) -> None:
            before, image = node.received(), frame(of.index)
            raw = np.full((image.height_px, image.width_px), depth, "<u2").data.cast("B")
            frames.put(msgspec.structs.replace(image, stamp_ns=of.stamp_ns, depth=raw))
            until(lambda: node.received() > before, 60)

        node.tell(lambda of: show(of, 0))
        node.tell(lambda of: show(of, 0), is_dead_reckoned=True)
        node.tell(lambda of: show(of, 10_000), is_dead_reckoned=True)
        seen_ns = node.tell(lambda of: show(of, 10_000))
    node.listener.wait_until(lambda: node.listener.count("/hsslam/points") > 0)
    (cloud,) = (one.by_rosbags for one in node.listener.heard("/hsslam/points"))
    assert _stamp_ns(cloud) == seen_ns and cloud.width > 0
    assert cloud.header.frame_id == "one/camera_optical_frame"


def test_frames_that_were_not_heard_do_not_shift_the_path(node, worker):
    """The recording waits after its first frame; the process does not hear the next ones."""
    seen = room_frames()[0]
    store = KeyframeStore.create(worker.arena, seen.camera, seen.depth_units_per_m, 16)
    log = PoseLog(worker.arena)
    stamps_ns = [10**18 + (k and 10**9) + 2 * k * _FRAME_NS for k in range(4)]
    for k, stamp_ns in enumerate(stamps_ns):
        store.append(replace(seen, index=k, stamp_ns=k * _FRAME_NS), np.eye(4))
        log.append(
            pose_row(
                index=k, source_stamp_ns=k * _FRAME_NS, stamp_ns=stamp_ns, publish_ns=stamp_ns,
                status=TRACKED, keyframe=k, T_world_cam=np.eye(4), T_keyframe_cam=np.eye(4),
                quality=1.0, map_version=1,
            )
        )  # fmt: skip
    node.listener.hear("/hsslam/path")
    until(lambda: node.tell() and node.listener.count("/hsslam/path"), 60)
    path = node.listener.heard("/hsslam/path")[0].by_rosbags
    assert [_stamp_ns(one) for one in path.poses] == stamps_ns


def test_frames_are_received_only_while_a_node_wants_points(run, node, worker):
    """They are 46 MB a second at 30 Hz."""
    another = RosListener(run.endpoint)
    another.hear("/hsslam/points")
    with Bus(run.endpoint, run.robot, "camera") as camera:
        frames = camera.publisher(topics.FRAME)
        until(lambda: node.tell() and frames.has_subscribers(), 60)
        another.close()
        until(lambda: node.tell() and not frames.has_subscribers(), 60)
    assert worker.bus.subscriptions == ()


def test_a_speed_that_is_not_known_is_told_as_such(node):
    """Filters take zeros for sure: a robot that was found after a gap does not stand still."""
    node.listener.hear("/hsslam/odom")
    until(lambda: node.tell() and node.listener.count("/hsslam/odom"), 60)
    stamps_ns = [
        node.tell(),
        node.tell(odometry_stands=True),
        node.tell(covariance=[]),
    ]
    by_stamp: dict[int, Any] = {}

    def are_heard() -> bool:
        heard = node.listener.heard("/hsslam/odom")
        by_stamp.update({_stamp_ns(one.by_rosbags): one.by_rosbags for one in heard})
        return by_stamp.keys() >= set(stamps_ns)

    until(are_heard, 60)
    moves, stands, unsure = (by_stamp[stamp_ns] for stamp_ns in stamps_ns)
    assert abs(moves.twist.twist.linear.y + 3.0) < 1e-4  # m/s, by the clock of the source
    assert 0.1 < moves.twist.covariance[0] < 0.3 and moves.pose.covariance[0] < 1e-3
    assert stands.twist.twist.linear.y == 0
    unknown = (1e6 * np.eye(6)).ravel()
    np.testing.assert_array_equal(stands.twist.covariance, unknown)
    np.testing.assert_array_equal(unsure.twist.covariance, unknown)
    np.testing.assert_array_equal(unsure.pose.covariance, unknown)


def test_the_covariance_of_odometry_has_the_axes_of_odom(node):
    """Corrections have turned them by 50 degrees against those of map."""
    topics_of_poses = ("/hsslam/pose", "/hsslam/odom")
    for topic in topics_of_poses:
        node.listener.hear(topic)
    until(lambda: node.tell() and all(map(node.listener.count, topics_of_poses)), 60)
    turn = np.deg2rad(25)  # half of the angle, about y of the camera, which points down
    stamp_ns = node.tell(
        odometry=[0, 0, 0, 0, np.sin(turn), 0, np.cos(turn)],
        covariance=wire_covariance(1e-4 * np.diag([1.0, 2, 3, 4, 5, 6])),
    )

    def told(topic: str) -> Any:
        heard = (one.by_rosbags for one in node.listener.heard(topic))
        return next((one.pose for one in heard if _stamp_ns(one) == stamp_ns), None)

    until(lambda: all(map(told, topics_of_poses)), 60)
    in_map, in_odom = map(told, topics_of_poses)
    by_map, by_odom = (np.reshape(one.covariance, (6, 6)) for one in (in_map, in_odom))
    expected = 1e-4 * np.array([3.0, 1, 2, 6, 4, 5]) + 1e-8  # z, x, y of the camera
    np.testing.assert_allclose(by_map, np.diag(expected), atol=1e-12)
    R = np.kron(np.eye(2), _rotation(in_odom.pose) @ _rotation(in_map.pose).T)
    assert abs(by_odom[0, 1]) > 5e-5
    np.testing.assert_allclose(by_odom, R @ by_map @ R.T, atol=1e-12)


def test_a_camera_in_a_fragment_has_odometry_and_no_place_in_the_map(node):
    """Its pose is one in the fragment: the local costmap goes on."""
    heard = ("/tf", "/hsslam/odom", "/hsslam/pose")
    for topic in heard:
        node.listener.hear(topic)
    until(lambda: node.tell() and all(map(node.listener.count, heard)), 60)
    fragment = {"status": "lost", "fragment": 1, "covariance": []}
    begins_ns = node.tell(**fragment, odometry_stands=True)
    goes_on_ns = node.tell(**fragment)
    lost_ns = node.tell(status="lost")
    found_ns = node.tell()
    odometry: dict[int, Any] = {}
    chains: dict[int, set[str]] = {}
    posed_ns: set[int] = set()

    def are_heard() -> bool:
        for one in node.listener.heard("/hsslam/odom"):
            odometry[_stamp_ns(one.by_rosbags)] = one.by_rosbags
        for one in node.listener.heard("/tf"):
            transforms = one.by_rosbags.transforms
            children = {each.child_frame_id for each in transforms}
            chains[_stamp_ns(transforms[0])] = children
        posed_ns.update(_stamp_ns(one.by_rosbags) for one in node.listener.heard("/hsslam/pose"))
        return all(found_ns in each for each in (odometry, chains, posed_ns))

    until(are_heard, 60)
    assert not posed_ns & {begins_ns, goes_on_ns, lost_ns}
    assert lost_ns not in odometry and lost_ns not in chains
    assert chains[begins_ns] == chains[goes_on_ns] == {"one/base_link"}
    assert chains[found_ns] == {"one/odom", "one/base_link"}
    moves = odometry[goes_on_ns]
    assert abs(moves.twist.twist.linear.y + 3.0) < 1e-4
    assert moves.pose.covariance[0] == 1e6 == odometry[begins_ns].twist.covariance[0]


def test_frames_of_a_robot_begin_with_its_prefix(node):
    """Two runs at one router must not mix their transforms."""
    for topic in ("/tf", "/hsslam/pose", "/hsslam/odom"):
        node.listener.hear(topic)
    node.listener.hear_latched("/tf_static")
    until(lambda: node.tell() and all(map(node.listener.count, ("/tf", "/hsslam/odom"))), 60)
    node.listener.wait_until(lambda: node.listener.count("/tf_static") > 0)
    names = {
        name
        for one in node.listener.heard()
        for each in getattr(one.by_rosbags, "transforms", [one.by_rosbags])
        for name in (each.header.frame_id, getattr(each, "child_frame_id", "one/map"))
    }
    assert names == {"one/map", "one/odom", "one/base_link", "one/camera_optical_frame"}


def test_a_frame_from_before_a_reset_that_is_sent_again_tells_nothing(run, node):
    """Its pose is one in the map of then."""
    MapState(run.arena_dir).map_epoch = 1
    node.listener.hear("/hsslam/pose")
    until(lambda: node.tell(map_epoch=1) and node.listener.count("/hsslam/pose"), 60)
    past_ns, now_ns = node.tell(map_epoch=0), node.tell(map_epoch=1)
    stamps_ns: list[int] = []

    def is_heard() -> bool:
        heard = node.listener.heard("/hsslam/pose")
        stamps_ns.extend(_stamp_ns(one.by_rosbags) for one in heard)
        return now_ns in stamps_ns

    until(is_heard, 60)
    assert past_ns not in stamps_ns


def _stamp_ns(message) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def _rotation(pose) -> np.ndarray:
    q = pose.orientation
    return transform(np.zeros(3), np.array([q.x, q.y, q.z, q.w]))[:3, :3]
