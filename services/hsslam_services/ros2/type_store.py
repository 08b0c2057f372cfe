"""Definitions of ROS messages: those of the package rosbags, and those that it lacks."""

import importlib.util
from typing import TYPE_CHECKING

from hsslam_node.errors import UserError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_REMEDY = "pip install 'hsslam-node[ros2]'"
_OF_ROS1 = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
}
# of Isaac ROS nvblox, https://github.com/NVIDIA-ISAAC-ROS/isaac_ros_nvblox
_OF_ROS2 = {
    "nvblox_msgs/msg/DistanceMapSlice": """\
std_msgs/Header header
float32 resolution
uint32 width
uint32 height
geometry_msgs/Point origin
float32 unknown_value
float32[] data
""",
}


def expect_packages(who: str) -> None:
    """Raise UserError if a package that `who` needs to send to ROS 2 is not installed."""
    for package in ("rosbags", "xxhash"):
        if importlib.util.find_spec(package) is None:
            raise UserError(f"{who}: package {package} is not installed: {_REMEDY}")


def open_type_store(who: str, is_ros1: bool = False) -> "Typestore":
    """The messages of ROS 2 Jazzy, or of ROS 1 Noetic.

    Raises:
        UserError: rosbags is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise UserError(f"{who}: package rosbags is not installed: {_REMEDY}") from None
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_JAZZY)
    for name, text in (_OF_ROS1 if is_ros1 else _OF_ROS2).items():
        store.register(get_types_from_msg(text, name))
    return store
