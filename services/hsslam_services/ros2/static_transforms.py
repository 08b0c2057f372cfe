"""Static transforms of ROS, `/tf_static`: the mounting of sensors."""

from collections import deque
from typing import Any

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import inverse, transform

TOPIC, TRANSFORMS = "/tf_static", "tf2_msgs/msg/TFMessage"
_UNIT = 1e-2  # by which the norm of a quaternion may be off


class StaticTransforms:
    """Keeps the newest transform to each child frame."""

    def __init__(self) -> None:
        self._to_parent: dict[str, tuple[str, np.ndarray]] = {}  # by child: parent, T_parent_child
        # answers since the last transform came; an IMU asks a thousand times a second
        self._known: dict[tuple[str, str], np.ndarray | None] = {}

    def take(self, message: Any) -> None:
        """Take the transforms of a `TFMessage`, decoded by rosbags.

        Raises:
            UserError: one is not finite, or has no unit quaternion; the others are taken.
        """
        problem = ""
        for stamped in message.transforms:
            parent, child = _name(stamped.header.frame_id), _name(stamped.child_frame_id)
            try:
                self._to_parent[child] = parent, pose_of(stamped.transform)
            except UserError as error:
                problem = problem or f"{parent} to {child}: {error}"
                continue
            self._known.clear()
        if problem:
            raise UserError(problem)

    def between(self, target: str, source: str) -> np.ndarray | None:
        """T_target_source, [4, 4]: the pose of a frame in another; None if no transforms connect the two."""
        ends = _name(target), _name(source)
        if ends not in self._known:
            self._known[ends] = self._searched(*ends)
        return self._known[ends]

    def _searched(self, target: str, source: str) -> np.ndarray | None:
        found, waiting = {source: np.eye(4)}, deque([source])  # T_frame_source
        while waiting:
            frame = waiting.popleft()
            if frame == target:
                return found[frame]
            for beside, T_beside_frame in self._beside(frame):
                if beside not in found:
                    found[beside] = T_beside_frame @ found[frame]
                    waiting.append(beside)
        return None

    def _beside(self, frame: str) -> list[tuple[str, np.ndarray]]:
        """Parent and children of a frame, each with T_beside_frame."""
        children = [
            (child, inverse(T)) for child, (parent, T) in self._to_parent.items() if parent == frame
        ]
        return [self._to_parent[frame], *children] if frame in self._to_parent else children


def pose_of(message: Any) -> np.ndarray:
    """The pose [4, 4] of a `Transform`, decoded by rosbags.

    Raises:
        UserError: it is not finite, or has no unit quaternion.
    """
    t, q = message.translation, message.rotation
    place, turn = np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w])
    numbers = np.concatenate([place, turn])
    if not np.isfinite(numbers).all() or abs(np.linalg.norm(turn) - 1) > _UNIT:
        text = " ".join(f"{number:g}" for number in numbers)
        raise UserError(f"{text}: expected x y z and a unit quaternion")
    return transform(place, turn)


def _name(frame_id: str) -> str:
    """The name without slashes at its ends: ROS 1 allowed a leading slash."""
    return frame_id.strip("/")
