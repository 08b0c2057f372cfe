"""What ROS 2 hears of single frames, told without a run."""

import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from hsslam_proto import topics
from hsslam_proto.messages import Pose
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.ros2_out import Ros2Out
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.node import RosNode
from tests.services.ros2.ros_listener import RosListener
from tests.services.wire_samples import frame, pose

_FRAME_NS = 33_333_333


class _Node:
    """A node that is told of poses, and a node of ROS that hears it."""

    def __init__(self, worker: Worker, node: RosNode, listener: RosListener) -> None:
        self._worker = worker
        self._out = Ros2Out(worker, node, RosMessages("test"))
        self.listener = listener
        self._index = 0

    def tell(self, sees: Callable[[Pose], None] | None = None, **fields: object) -> int:
        """Tell of the next frame, and show it before with `sees`; returns its stamp, ns."""
        self._index += 1
        stamp_ns = 10**18 + self._index * _FRAME_NS
        told = msgspec.structs.replace(pose(self._index), stamp_ns=stamp_ns, **fields)
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
    return replace(make_run(ros2_out="/hsslam"), supervisor_pid=os.getppid())


@pytest.fixture
def node(run) -> Iterator[_Node]:
    listener = RosListener(run.endpoint)
    with (
        Worker("ros2_out", run) as worker,
        RosNode(run.endpoint, 0, "/hsslam", "slam", RosMessages("test")) as ros,
    ):
        yield _Node(worker, ros, listener)
    listener.close()


def _until(is_met: Callable[[], object]) -> None:
    pause = threading.Event()
    for _ in range(6000):
        if is_met():
            return
        pause.wait(0.01)
    raise AssertionError("it never came")


def test_a_camera_that_sees_nothing_publishes_no_points(run, node):
    """Without any a collision monitor stops the robot; an empty cloud says that its way is free."""
    node.listener.hear("/hsslam/points")
    _until(lambda: node.tell() and node.received() >= 0)
    with Bus(run.endpoint, run.robot, "camera") as camera:
        frames = camera.publisher(topics.FRAME)
        _until(frames.has_subscribers)

        def show(of: Pose, depth: int) -> None:
            before, image = node.received(), frame(of.index)
            raw = np.full((image.height_px, image.width_px), depth, "<u2").data.cast("B")
            frames.put(msgspec.structs.replace(image, stamp_ns=of.stamp_ns, depth=raw))
            _until(lambda: node.received() > before)

        node.tell(lambda of: show(of, 0))
        node.tell(lambda of: show(of, 0), is_dead_reckoned=True)
        node.tell(lambda of: show(of, 10_000), is_dead_reckoned=True)
        seen_ns = node.tell(lambda of: show(of, 10_000))
    node.listener.wait_until(lambda: node.listener.count("/hsslam/points") > 0)
    (cloud,) = (one.by_rosbags for one in node.listener.heard("/hsslam/points"))
    stamp = cloud.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == seen_ns and cloud.width > 0
