"""When a message of ROS was measured; alone, as images and sensors of nodes and bags read it."""

from typing import Any


def header_stamp_ns(message: Any) -> int:
    """Stamp of the header of a message decoded by rosbags, ns."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
