"""Bags of the three kinds, written by the writers of rosbags."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera

KINDS = ("db3", "mcap", "bag")  # ROS 2 twice, ROS 1
COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
INFO = "/camera/color/camera_info"
_STORAGE = {"db3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}


class BagWriter:
    """Makes messages of one version of ROS, and writes them at the times of their stamps, or so much later
    as `recorded_later_ns` says; `kept_bytes`: only the beginning of each."""

    recorded_later_ns = 0
    kept_bytes: int | None = None

    def __init__(self, writer: Any, is_ros1: bool) -> None:
        self._writer = writer
        self._is_ros1 = is_ros1
        self._store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_JAZZY)
        if is_ros1:
            text = "geometry_msgs/TransformStamped[] transforms"
            self._store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
        self._connections: dict[str, Any] = {}

    def put(
        self, topic: str, stamp_ns: int, name: str, *, frame_id: str = "camera", **fields: Any
    ) -> None:
        """A message of sensor_msgs, or an `Odometry`, whose header has this stamp."""
        package = "nav_msgs" if name == "Odometry" else "sensor_msgs"
        kind = f"{package}/msg/{name}"
        header = self._header(stamp_ns, frame_id)
        self._write(topic, stamp_ns, kind, self._new(kind, header=header, **fields))

    def _header(self, stamp_ns: int, frame_id: str) -> Any:
        return self._new("std_msgs/msg/Header", stamp=self._time(stamp_ns), frame_id=frame_id)

    def announce(self, topic: str, kind: str) -> None:
        """A topic of this type, perhaps without messages."""
        if topic not in self._connections:
            added = self._writer.add_connection(topic, kind, typestore=self._store)
            self._connections[topic] = added

    def _write(self, topic: str, stamp_ns: int, kind: str, message: Any) -> None:
        store = self._store
        self.announce(topic, kind)
        serialize = store.serialize_ros1 if self._is_ros1 else store.serialize_cdr
        recorded_ns = stamp_ns + self.recorded_later_ns
        payload = bytes(serialize(message, kind))[: self.kept_bytes]
        self._writer.write(self._connections[topic], recorded_ns, payload)

    def image(
        self,
        topic: str,
        stamp_ns: int,
        pixels: np.ndarray,
        encoding: str,
        *,
        frame_id: str = "camera",
    ) -> None:
        """An `Image` of pixels [H, W] or [H, W, channels]."""
        height, width = pixels.shape[:2]
        size = {"height": height, "width": width, "step": pixels.nbytes // height}
        data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
        fields = {"encoding": encoding, "is_bigendian": 0, "data": data}
        self.put(topic, stamp_ns, "Image", frame_id=frame_id, **size, **fields)

    def file(self, topic: str, stamp_ns: int, data: np.ndarray, encoding: str) -> None:
        """A `CompressedImage` of an image file [N] uint8."""
        self.put(topic, stamp_ns, "CompressedImage", format=encoding, data=data)

    def info(self, topic: str, stamp_ns: int, camera: Camera, *, scale: float = 2.0) -> None:
        """A `CameraInfo`; P is for images of `scale` times the focal length."""
        self.intrinsics(topic, stamp_ns, camera, camera.K, scale=scale)

    def intrinsics(
        self, topic: str, stamp_ns: int, camera: Camera, K: np.ndarray, *, scale: float = 2.0
    ) -> None:
        """As `info`, with this K [3, 3] for the camera's."""
        scaled = np.diag([scale, scale, 1.0]) @ np.hstack([K, np.zeros((3, 1))])
        matrices = {"k": K.ravel(), "r": np.eye(3).ravel(), "p": scaled.ravel()}
        matrices["d"] = np.array(camera.distortion or 5 * (0.0,))
        named = {name.upper() if self._is_ros1 else name: m for name, m in matrices.items()}
        no_roi = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        roi = self._new("sensor_msgs/msg/RegionOfInterest", **no_roi)
        size = {"height": camera.height_px, "width": camera.width_px}
        fields = {"distortion_model": "plumb_bob", "binning_x": 0, "binning_y": 0, "roi": roi}
        self.put(topic, stamp_ns, "CameraInfo", **size, **fields, **named)

    def odometry(self, topic: str, stamp_ns: int, numbers: Sequence[float]) -> None:
        """An `Odometry` of a base at x, y, z, qx, qy, qz, qw."""
        x, y, z, *q = numbers
        still = self._new("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        at = self._new(
            "geometry_msgs/msg/Pose",
            position=self._new("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self._new(
                "geometry_msgs/msg/Quaternion", **dict(zip("xyzw", q, strict=True))
            ),
        )
        twist = self._new("geometry_msgs/msg/Twist", linear=still, angular=still)
        none = np.zeros(36)
        self.put(
            topic, stamp_ns, "Odometry", child_frame_id="base_link",
            pose=self._new("geometry_msgs/msg/PoseWithCovariance", pose=at, covariance=none),
            twist=self._new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=none),
        )  # fmt: skip

    def imu(
        self, topic: str, stamp_ns: int, rates: Sequence[float], forces: Sequence[float]
    ) -> None:
        """An `Imu` without orientation."""
        vector = lambda numbers: self._new(  # noqa: E731
            "geometry_msgs/msg/Vector3", **dict(zip("xyz", numbers, strict=True))
        )
        unknown, none = np.full(9, -1.0), np.zeros(9)
        self.put(
            topic, stamp_ns, "Imu", frame_id="imu",
            orientation=self._new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=unknown, angular_velocity=vector(rates),
            angular_velocity_covariance=none, linear_acceleration=vector(forces),
            linear_acceleration_covariance=none,
        )  # fmt: skip

    def static_transforms(
        self, stamp_ns: int, of: Sequence[tuple[str, str, Sequence[float]]]
    ) -> None:
        """A message on `/tf_static` of (parent, child, x y z qx qy qz qw of the child in the parent)."""
        stamped = []
        for parent, child, numbers in of:
            moved = self._transform(numbers)
            header = self._header(stamp_ns, parent)
            kind = "geometry_msgs/msg/TransformStamped"
            stamped.append(self._new(kind, header=header, child_frame_id=child, transform=moved))
        kind = "tf2_msgs/msg/TFMessage"
        self._write("/tf_static", stamp_ns, kind, self._new(kind, transforms=stamped))

    def transform(self, topic: str, stamp_ns: int, numbers: Sequence[float]) -> None:
        """A `Transform` x y z qx qy qz qw, recorded at this time."""
        self._write(topic, stamp_ns, "geometry_msgs/msg/Transform", self._transform(numbers))

    def number(self, topic: str, stamp_ns: int, value: float) -> None:
        """A `Float32`, recorded at this time."""
        kind = "std_msgs/msg/Float32"
        self._write(topic, stamp_ns, kind, self._new(kind, data=value))

    def _transform(self, numbers: Sequence[float]) -> Any:
        x, y, z, *q = numbers
        turn = self._new("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", q, strict=True)))
        place = self._new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)
        return self._new("geometry_msgs/msg/Transform", translation=place, rotation=turn)

    def frame(
        self, frame: Frame, depth_lag_ns: int = 0, distortion: tuple[float, ...] = ()
    ) -> None:
        """Colour, depth and intrinsics of a frame, on the topics of a RealSense with aligned depth."""
        self.info(INFO, frame.stamp_ns, replace(frame.camera, distortion=distortion))
        self.image(COLOR, frame.stamp_ns, frame.color, "rgb8")
        self.image(DEPTH, frame.stamp_ns + depth_lag_ns, frame.depth_raw, "16UC1")

    def _new(self, kind: str, **fields: Any) -> Any:
        of_ros1 = {"seq": 0} if self._is_ros1 and kind.endswith("/Header") else {}
        return self._store.types[kind](**of_ros1, **fields)

    def _time(self, stamp_ns: int) -> Any:
        seconds, rest = divmod(stamp_ns, 1_000_000_000)
        return self._new("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)


@contextmanager
def new_bag(
    path: Path, kind: str, compressed: CompressionMode = CompressionMode.NONE
) -> Iterator[BagWriter]:
    """A bag at `path`, which is a folder unless it is one of ROS 1; `compressed`: what is, in ROS 2."""
    if kind == "bag":
        with Ros1Writer(path) as ros1:
            yield BagWriter(ros1, is_ros1=True)
    else:
        writer = Ros2Writer(path, version=9, storage_plugin=_STORAGE[kind])
        writer.set_compression(compressed, CompressionFormat.ZSTD)
        with writer as ros2:
            yield BagWriter(ros2, is_ros1=False)


def written(
    folder: Path,
    kind: str,
    frames: Sequence[Frame],
    more: Callable[[BagWriter], None] = lambda bag: None,
    depth_lag_ns: int = 0,
    distortion: tuple[float, ...] = (),
) -> Path:
    """The bag of these frames, with `more` in it."""
    path = folder / ("recorded.bag" if kind == "bag" else f"recorded_{kind}")
    with new_bag(path, kind) as bag:
        more(bag)
        for frame in frames:
            bag.frame(frame, depth_lag_ns, distortion)
    return path
