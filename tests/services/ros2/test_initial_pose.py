"""Poses that a node of ROS sends to `/initialpose`, and what is asked and told of them."""

import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore

from hsslam_node.geometry.se3 import se3_exp
from hsslam_proto.request_messages import Locate, Located, Refusal
from hsslam_services.ros2.initial_pose import KIND, TOPIC, InitialPose
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.names import TopicName
from hsslam_services.ros2.node import RosNode
from tests.services.ros2.ros_listener import RosListener

_MESSAGES = RosMessages("test")
_HASH = get_typestore(Stores.ROS2_KILTED).hash_rihs01(KIND)


@dataclass
class Asked:
    """What was asked and told; answers wait until they may come."""

    answer: Located | Refusal
    may_answer: threading.Event = field(default_factory=threading.Event)
    questions: list[Locate] = field(default_factory=list)
    told: list[tuple[str, str]] = field(default_factory=list)

    def ask(self, question: Locate) -> Located | Refusal:
        self.questions.append(question)
        assert self.may_answer.wait(60)
        return self.answer


@pytest.fixture
def rviz(endpoint):
    """Publishes as RViz does."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    with zenoh.open(config) as session:
        yield session.declare_publisher(TopicName(TOPIC, KIND, _HASH).key(0))


@pytest.fixture
def node(endpoint):
    with RosNode(endpoint, 0, "/hsslam", "slam", _MESSAGES) as node:
        yield node


def _pose(frame: str, x: float, y: float, yaw_rad: float, tilt_rad: float = 0.0) -> bytes:
    turn = se3_exp(np.array([0, 0, 0, 0, 0, yaw_rad]))
    T = turn @ se3_exp(np.array([0, 0, 0, tilt_rad, 0, 0]))
    T[:2, 3] = x, y
    return _MESSAGES.encoded(_MESSAGES.pose(1, frame, T, None))


def _initial(node: RosNode, asked: Asked) -> InitialPose:
    def tell(level: str, text: str) -> None:
        asked.told.append((level, text))

    return InitialPose(node, _MESSAGES, "map", asked.ask, tell)


def _put(rviz: zenoh.Publisher, payload: bytes) -> None:
    """Once the subscription is known."""
    pause = threading.Event()
    for _ in range(6000):
        status = rviz.matching_status  # the stubs of zenoh 1.10 call it a bool
        if getattr(status, "matching", status):
            break
        pause.wait(0.01)
    rviz.put(payload)


def _hear_until(initial: InitialPose, is_met: Callable[[], object]) -> None:
    pause = threading.Event()
    for _ in range(6000):
        initial.hear()
        if is_met():
            return
        pause.wait(0.01)
    raise AssertionError("it never came")


def test_the_newest_pose_is_asked_for_and_its_answer_told(node, rviz):
    found = Located(index=5, x=1.0, y=-2.0, yaw_deg=91.0, up_by="gravity")
    asked = Asked(found)
    initial = _initial(node, asked)
    _put(rviz, _pose("map", 1.1, -2.2, 0.5 * np.pi))
    _hear_until(initial, lambda: asked.questions)
    (question,) = asked.questions
    np.testing.assert_allclose((question.x, question.y, question.yaw_deg), (1.1, -2.2, 90.0))
    assert not asked.told
    asked.may_answer.set()
    _hear_until(initial, lambda: asked.told)
    assert asked.told == [
        ("info", "/initialpose: the camera is found at 1.00 -2.00 91 (m, m, degrees)")
    ]


def test_of_a_robot_that_is_tilted_a_little_the_heading_counts(node, rviz):
    """As in `/hsslam/pose`, which is never quite level."""
    asked = Asked(Refusal(reason="failed", text=""))
    asked.may_answer.set()
    initial = _initial(node, asked)
    _put(rviz, _pose("map", 1.0, 2.0, -0.75 * np.pi, tilt_rad=np.deg2rad(9)))
    _hear_until(initial, lambda: asked.told)
    (question,) = asked.questions
    np.testing.assert_allclose((question.x, question.y, question.yaw_deg), (1.0, 2.0, -135.0))


def test_a_refusal_is_told(node, rviz):
    asked = Asked(Refusal(reason="failed", text="locate: not found at 0.00 0.00 0"))
    asked.may_answer.set()
    initial = _initial(node, asked)
    _put(rviz, _pose("/map", 0, 0, 0))
    _hear_until(initial, lambda: asked.told)
    assert asked.told == [("warning", "/initialpose: locate: not found at 0.00 0.00 0")]


@pytest.mark.parametrize(
    ("payload", "text"),
    [
        (_pose("odom", 0, 0, 0), "frame_id 'odom': expected 'map'"),
        (_pose("map", np.nan, 0, 0), "position nan 0, .*expected finite numbers"),
        (_pose("map", 0, 0, 0, tilt_rad=0.2), "expected .*a rotation about z, tilted by 10 deg"),
        (b"\x00\x01\x00\x00abc", f"expected {KIND} in CDR"),
        (b"", f"expected {KIND} in CDR"),
    ],
)
def test_what_is_no_pose_on_the_floor_of_the_map_is_told(node, rviz, payload, text):
    asked = Asked(Refusal(reason="failed", text=""))
    initial = _initial(node, asked)
    _put(rviz, payload)
    _hear_until(initial, lambda: asked.told)
    ((level, told),) = asked.told
    assert level == "warning" and told.startswith("/initialpose: ")
    assert re.search(text, told), told
    assert not asked.questions


def test_the_graph_of_ros_shows_the_subscription(endpoint, node):
    listener = RosListener(endpoint)
    try:
        _initial(node, Asked(Refusal(reason="failed", text="")))
        listener.wait_until(lambda: listener.alive() == 2)
        (token,) = (token for token in listener.tokens() if "/MS/" in token)
        kind = f"geometry_msgs::msg::dds_::PoseWithCovarianceStamped_/{_HASH}"
        assert token.endswith(f"/%/%hsslam/slam/%initialpose/{kind}/::,10:,:,:,,")
    finally:
        listener.close()
