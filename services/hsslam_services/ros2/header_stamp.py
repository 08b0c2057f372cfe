"""Header stamp of a ROS message; alone, as readers of nodes and of bags share it."""

from typing import Any


def header_stamp_ns(message: Any) -> int:
    """Header stamp of a message decoded by rosbags, ns."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
