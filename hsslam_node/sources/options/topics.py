"""Which topics of ROS are read: of a running camera, or of a bag."""

import re
from dataclasses import dataclass

from hsslam_node.errors import UserError
from hsslam_node.sources.options.limits import expect_range

ROS_ROUTER = "tcp/127.0.0.1:7447"  # where ROS nodes look for one


def info_beside(image_topic: str) -> str:
    """The topic of the intrinsics of an image topic, compressed or not: its neighbour in ROS."""
    image = image_topic.removesuffix("/compressed").removesuffix("/compressedDepth")
    return f"{image.rpartition('/')[0]}/camera_info"


@dataclass(frozen=True)
class Ros2Options:
    """Topics of ros2:/camera; a name without a leading / is below /camera."""

    color: str = "color/image_raw"
    """Colour images; a name ending in /compressed is JPEG or PNG."""
    depth: str = "aligned_depth_to_color/image_raw"
    """Depth images, best aligned to colour."""
    info: str = ""
    """Intrinsics (empty: camera_info beside the colour images)."""
    domain: int = 0
    """Domain of the ROS nodes: their ROS_DOMAIN_ID, which is not read."""
    connect: str = ""
    """Router of ROS nodes (empty: on port 7447 here, our own or rmw_zenohd)."""
    odometry: str = ""
    """Odometry of the robot, nav_msgs/Odometry, e.g. /odom (empty: none)."""
    imu: str = ""
    """IMU of the camera, sensor_msgs/Imu, e.g. /camera/imu (empty: none)."""
    max_dt_ms: float | None = None
    """Largest time between a colour image and its depth image, ms (empty: 20, or 0.6 periods if longer)."""
    timeout_s: float = 10.0
    """Longest wait for the router, and then for the first images, s."""

    def __post_init__(self) -> None:
        for name in ("color", "depth", "info", "odometry", "imu"):
            topic = getattr(self, name)
            if topic or name in ("color", "depth"):
                _expect_topic(f"--ros2.{name}", topic)
        expect_range("ros2.domain", self.domain, 0, 232)
        if self.connect and not re.fullmatch(r"[a-z-]+/\S+", self.connect):
            raise UserError(f"--ros2.connect {self.connect!r}: expected e.g. tcp/127.0.0.1:7447")
        if self.max_dt_ms is not None:
            expect_range("ros2.max-dt-ms", self.max_dt_ms, 0, 1000)
        if not 0 < self.timeout_s <= 3600:
            raise UserError(f"--ros2.timeout-s {self.timeout_s}: expected above 0, up to 3600")

    def topics_under(self, name: str) -> tuple[str, str, str]:
        """Topics of colour, depth and intrinsics of the camera of this name (`/camera`).

        Raises:
            UserError: not a ROS 2 namespace.
        """
        if not re.fullmatch(r"/|(/\w+)+", name):
            raise UserError(f"source ros2:{name}: expected the camera's namespace: ros2:/camera")
        color, depth = (_below(name, topic) for topic in (self.color, self.depth))
        return color, depth, _below(name, self.info) if self.info else info_beside(color)

    def topic_of_odometry(self, name: str) -> str:
        """The topic of odometry of the camera of this name; empty if there is none."""
        return _below(name, self.odometry) if self.odometry else ""

    def topic_of_imu(self, name: str) -> str:
        """The topic of the IMU of the camera of this name; empty if there is none."""
        return _below(name, self.imu) if self.imu else ""


@dataclass(frozen=True)
class BagOptions:
    """Topics of bag:FOLDER and bag:FILE; without them the bag must have one of each."""

    color: str = ""
    """Colour images (empty: the only topic of colour)."""
    depth: str = ""
    """Depth images (empty: the only topic of depth, or the only aligned one)."""
    info: str = ""
    """Intrinsics (empty: camera_info beside the colour images)."""
    odometry: str = ""
    """Odometry of the robot, nav_msgs/Odometry (empty: none is used)."""
    imu: str = ""
    """IMU, sensor_msgs/Imu (empty: of a RealSense recording, or the only one if --camera-T-imu is set)."""
    max_dt_ms: float | None = None
    """Largest time between a colour image and its depth image, ms (empty: 20, or 0.6 periods if longer)."""

    def __post_init__(self) -> None:
        for name in ("color", "depth", "info", "odometry", "imu"):
            topic = getattr(self, name)
            if topic:
                _expect_topic(f"--bag.{name}", topic)
        if self.max_dt_ms is not None:
            expect_range("bag.max-dt-ms", self.max_dt_ms, 0, 1000)


def _expect_topic(option: str, topic: str) -> None:
    if not re.fullmatch(r"/?\w+(/\w+)*", topic):
        raise UserError(f"{option} {topic!r}: expected the name of a topic")


def _below(name: str, topic: str) -> str:
    return topic if topic.startswith("/") else f"{name.rstrip('/')}/{topic}"
