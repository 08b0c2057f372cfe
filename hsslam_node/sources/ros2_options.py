"""Which topics of ROS 2 are a camera, and where they are."""

import re
from dataclasses import dataclass

from hsslam_node.errors import UserError


@dataclass(frozen=True)
class Ros2Options:
    """Topics of ros2:/camera; a name without a leading / is below /camera."""

    color: str = "color/image_raw"
    """Colour images; a name ending in /compressed is JPEG or PNG."""
    depth: str = "aligned_depth_to_color/image_raw"
    """Depth images, registered to colour."""
    info: str = ""
    """Intrinsics (empty: camera_info beside the colour images)."""
    domain: int = 0
    """ROS_DOMAIN_ID of the ROS nodes."""
    connect: str = "tcp/127.0.0.1:7447"
    """Zenoh router of the ROS nodes: rmw_zenohd or this service."""
    max_dt_ms: float = 15.0
    """Largest time between a colour image and its depth image, ms."""
    timeout_s: float = 10.0
    """Longest wait for the first images, s."""

    def __post_init__(self) -> None:
        for name in ("color", "depth", "info"):
            topic = getattr(self, name)
            if not re.fullmatch(r"/?\w+(/\w+)*", topic) and not (name == "info" and topic == ""):
                raise UserError(f"--ros2.{name} {topic!r}: expected the name of a topic")
        if not 0 <= self.domain <= 232:
            raise UserError(f"--ros2.domain {self.domain}: expected 0 to 232")
        if not re.fullmatch(r"[a-z]+/\S+", self.connect):
            raise UserError(f"--ros2.connect {self.connect!r}: expected as tcp/127.0.0.1:7447")
        if not 0 <= self.max_dt_ms <= 1000:
            raise UserError(f"--ros2.max-dt-ms {self.max_dt_ms}: expected 0 to 1000")
        if not 0 < self.timeout_s <= 3600:
            raise UserError(f"--ros2.timeout-s {self.timeout_s}: expected above 0, up to 3600")

    def topics_under(self, name: str) -> tuple[str, str, str]:
        """Topics of colour, depth and intrinsics of the camera of this name (`/camera`).

        Raises:
            UserError: no name of a ROS 2 namespace.
        """
        if not re.fullmatch(r"/|(/\w+)+", name):
            raise UserError(f"source ros2:{name}: expected the camera's namespace, as ros2:/camera")
        color, depth = (_below(name, topic) for topic in (self.color, self.depth))
        beside = f"{color.removesuffix('/compressed').rpartition('/')[0]}/camera_info"
        return color, depth, _below(name, self.info) if self.info else beside


def _below(name: str, topic: str) -> str:
    return topic if topic.startswith("/") else f"{name.rstrip('/')}/{topic}"
