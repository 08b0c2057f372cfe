"""Relocalises the camera near the pose set in RViz, `/initialpose`, as the request `locate` does."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Literal

import numpy as np

from hsslam_node.errors import UserError
from hsslam_proto.request_messages import Locate, Located, Refusal
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.names import Qos
from hsslam_services.ros2.node import RosNode

TOPIC, KIND = "/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped"
_UNIT = 1e-2  # largest difference of a quaternion's norm from 1
_MOST_TILT_DEG = 10.0  # of a robot on a floor
_LEAST_LEVEL = np.cos(np.deg2rad(_MOST_TILT_DEG))  # of the robot's z axis along the map's
Tell = Callable[[Literal["info", "warning"], str], None]


class InitialPose:
    """Sends `locate` for the newest pose, in a separate thread, as the answer takes several frames.

    Args:
        frame: name of the map's frame in ROS; poses must be in it.
        ask: answers `locate`.
        tell: reports the result; called by `hear`.
    """

    def __init__(
        self, node: RosNode, messages: RosMessages, frame: str,
        ask: Callable[[Locate], Located | Refusal], tell: Tell,
    ) -> None:  # fmt: skip
        self._messages = messages
        self._frame = frame
        self._ask = ask
        self._tell = tell
        self._poses = node.subscription(TOPIC, KIND, Qos(10))
        self._thread = ThreadPoolExecutor(1, "locate")
        self._asked: Future[Located | Refusal] | None = None

    def hear(self) -> None:
        """Report the last result and start to look near the newest pose; never waits."""
        if self._asked is not None:
            if not self._asked.done():
                return
            self._report(self._asked.result())
            self._asked = None
        payload = self._poses.newest()
        if payload is None:
            return
        try:
            question = self._question(payload)
        except UserError as error:
            self._tell("warning", f"{TOPIC}: {error}")
            return
        self._asked = self._thread.submit(self._ask, question)

    def _question(self, payload: bytes) -> Locate:
        """The request for a message; UserError if it has no level pose in the frame of the map."""
        message: Any = self._messages.decoded(payload, KIND)
        frame = str(message.header.frame_id).strip("/")
        if frame != self._frame:
            raise UserError(f"frame_id {frame!r}: expected {self._frame!r}")
        p, o = message.pose.pose.position, message.pose.pose.orientation
        x, y, z, w = (float(value) for value in (o.x, o.y, o.z, o.w))
        is_level = 1 - 2 * (x * x + y * y) >= _LEAST_LEVEL
        is_unit = abs(np.linalg.norm([x, y, z, w]) - 1) < _UNIT
        if not (np.isfinite([p.x, p.y]).all() and is_unit and is_level):
            raise UserError(
                f"position {p.x:g} {p.y:g}, orientation {x:g} {y:g} {z:g} {w:g}: expected finite numbers and "
                f"a rotation about z, tilted by {_MOST_TILT_DEG:g} degrees at most"
            )
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return Locate(x=float(p.x), y=float(p.y), yaw_deg=float(np.rad2deg(yaw)))

    def _report(self, answer: Located | Refusal) -> None:
        if isinstance(answer, Refusal):
            self._tell("warning", f"{TOPIC}: {answer.text}")
            return
        found = f"{answer.x:.2f} {answer.y:.2f} {answer.yaw_deg:.0f}"
        self._tell("info", f"{TOPIC}: the camera is found at {found} (m, m, degrees)")
