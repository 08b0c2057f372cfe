"""What recordings of the RealSense viewer and SDK have beside ROS: mountings, the unit of depth, a split IMU.

Their topics are `/device_0/sensor_0/Depth_0/image/data` and so on. Older versions of the SDK, such as 2.55,
write a `.bag`; newer ones, such as 2.59, write a `.db3`, which has its transforms on `/tf_static`.
Source: librealsense, src/media/ros/ros_file_format.h and ros_writer.cpp.
"""

import re
from collections.abc import Sequence

import numpy as np

from hsslam_node.geometry.se3 import inverse
from hsslam_services.camera.bags.bag_file import BagFile
from hsslam_services.ros2.static_transforms import pose_of

_STREAM = re.compile(r"(/device_\d+/sensor_\d+)/\w+_\d+(?=/(?:image|imu)/data)")
_GYROSCOPE = re.compile(r"(/device_\d+/sensor_\d+)/Gyro(_\d+/imu/data)")
_TRANSFORM = "geometry_msgs/msg/Transform"
_FLOAT, _TEXT = "std_msgs/msg/Float32", "std_msgs/msg/String"


def mounted_at(bag: BagFile, color: str, other: str) -> np.ndarray | None:
    """T_color_other, [4, 4], from the topics `tf` of both streams of a `.bag`; None if it has none.

    other: topic of depth, or of one part of the IMU.

    Raises:
        UserError: the bag is damaged, or a transform is not valid.
        BadImageError: a message is too short.
    """
    T_color, T_other = _to_stream(bag, color), _to_stream(bag, other)
    for reference in T_color.keys() & T_other.keys():
        return T_color[reference] @ inverse(T_other[reference])
    return None


def imu_pairs(topics: Sequence[str]) -> list[tuple[str, str]]:
    """Gyroscope and accelerometer of each IMU that has both among these topics."""
    found = [(name, _GYROSCOPE.sub(r"\1/Accel\2", name)) for name in topics]
    return [(name, beside) for name, beside in found if beside != name and beside in topics]


def are_of_one_device(one: str, other: str) -> bool:
    """Whether the topics are of streams of the same camera."""
    return one.partition("/sensor_")[0] == other.partition("/sensor_")[0]


def depth_units_per_m(bag: BagFile, depth: str) -> float | None:
    """Units of depth per metre, from the option of the camera; None if the recording has none.

    Raises:
        UserError: the bag is damaged.
        BadImageError: the message is too short.
    """
    stream = _STREAM.match(depth)
    if stream is None:
        return None
    for name in ("Depth_Units", "Depth Units"):
        topic = f"{stream[1]}/option/{name}/value"
        kind = bag.type_of(topic)
        if kind in (_FLOAT, _TEXT) and (payload := bag.first_payload(topic)):
            metres = _number(bag.decode.of_type(payload, kind, kind).data)
            # a number of 32 bits: 0.001 is 1000.00 units per metre, not 999.99995
            return float(f"{1.0 / metres:.6g}") if metres > 0 else None
    return None


def _to_stream(bag: BagFile, topic: str) -> dict[str, np.ndarray]:
    """T_stream_reference of the stream of a topic, [4, 4], by the number of the reference."""
    stream = _STREAM.match(topic)
    found = {}
    for known in bag.topics if stream else ():
        name, _, reference = known.name.rpartition("/")
        if stream and name == f"{stream[0]}/tf" and known.type_name == _TRANSFORM:
            payload = bag.first_payload(known.name)
            if payload:
                found[reference] = pose_of(bag.decode.of_type(payload, _TRANSFORM, _TRANSFORM))
    return found


def _number(text: float | str) -> float:
    """A number that a `.bag` has as such and a `.db3` as text; 0 if it is none."""
    try:
        return float(text)
    except ValueError:
        return 0.0
