"""Makes ROS 2 messages from arrays, and encodes them in CDR."""

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import quaternion_from_rotation
from hsslam_services.ros2.type_store import open_type_store

_SURE = 1e-8  # m^2, rad^2: filters cannot use a variance of 0
_UNKNOWN = 1e6  # m^2, rad^2: ROS has zeros for unknown, but filters take them for a perfect pose
_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
_FLOAT32 = 7  # of sensor_msgs/PointField
_LATEST_NS = 2**31 * 10**9 - 1  # ROS counts seconds in 32 bits
Kind = Literal[
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/OccupancyGrid",
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/Path",
    "nvblox_msgs/msg/DistanceMapSlice",
    "sensor_msgs/msg/PointCloud2",
    "tf2_msgs/msg/TFMessage",
]


class RosMessages:
    """Makes messages and encodes them. Poses are [4, 4], stamps ns since 1970, covariances [6, 6] of x, y, z
    (m) and of rotations about the fixed axes x, y, z (rad) of the frame in the header.

    Raises:
        UserError: rosbags is not installed.
    """

    def __init__(self, who: str) -> None:
        self._store = open_type_store(who)

    def type_hash(self, kind: Kind) -> str:
        """The hash of a type, `RIHS01_...`; ROS 2 has it since Iron."""
        return self._store.hash_rihs01(kind)

    def encoded(self, message: Any) -> bytes:
        """The message in CDR."""
        return bytes(self._store.serialize_cdr(message, message.__msgtype__))

    def decoded(self, payload: bytes, kind: Kind) -> Any:
        """The message in CDR.

        Raises:
            UserError: the payload is no message of this kind.
        """
        from rosbags.serde import SerdeError

        try:
            return self._store.deserialize_cdr(payload, kind)
        except SerdeError as error:
            raise UserError(f"{error}: expected {kind} in CDR") from None

    def odometry(
        self,
        stamp_ns: int,
        frames: tuple[str, str],
        T: np.ndarray,
        covariance: np.ndarray | None,
        twist: np.ndarray,
        twist_covariance: np.ndarray | None,
    ) -> Any:
        """`nav_msgs/Odometry` of a frame in another, `frames` = (child, parent).

        twist: [6] m/s and rad/s in the axes of the child; so is its covariance.
        """
        child, parent = frames
        linear, angular = (self._vector(part) for part in (twist[:3], twist[3:]))
        moving = self._new("geometry_msgs/msg/Twist", linear=linear, angular=angular)
        return self._new(
            "nav_msgs/msg/Odometry",
            header=self._header(stamp_ns, parent),
            child_frame_id=child,
            pose=self._uncertain_pose(T, covariance),
            twist=self._new(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=moving,
                covariance=_row_by_row(twist_covariance),
            ),
        )

    def pose(self, stamp_ns: int, frame: str, T: np.ndarray, covariance: np.ndarray | None) -> Any:
        """`geometry_msgs/PoseWithCovarianceStamped`."""
        return self._new(
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            header=self._header(stamp_ns, frame),
            pose=self._uncertain_pose(T, covariance),
        )

    def path(self, stamp_ns: int, frame: str, stamps_ns: Sequence[int], poses: np.ndarray) -> Any:
        """`nav_msgs/Path` of poses [n, 4, 4], each with its stamp."""
        stamped = [
            self._new(
                "geometry_msgs/msg/PoseStamped",
                header=self._header(int(own_ns), frame),
                pose=self._pose(T),
            )
            for own_ns, T in zip(stamps_ns, poses, strict=True)
        ]
        header = self._header(stamp_ns, frame)
        return self._new("nav_msgs/msg/Path", header=header, poses=stamped)

    def transforms(self, stamp_ns: int, of: Iterable[tuple[str, str, np.ndarray]]) -> Any:
        """`tf2_msgs/TFMessage` of (parent, child, T_parent_child [4, 4])."""
        stamped = [
            self._new(
                "geometry_msgs/msg/TransformStamped",
                header=self._header(stamp_ns, parent),
                child_frame_id=child,
                transform=self._new(
                    "geometry_msgs/msg/Transform",
                    translation=self._vector(T[:3, 3]),
                    rotation=self._quaternion(T),
                ),
            )
            for parent, child, T in of
        ]
        return self._new("tf2_msgs/msg/TFMessage", transforms=stamped)

    def cloud(self, stamp_ns: int, frame: str, points: np.ndarray, colors: np.ndarray) -> Any:
        """`sensor_msgs/PointCloud2` of points [n, 3] m with colours [n, 3] uint8 RGB: x, y, z, rgb."""
        data = np.empty(len(points), _POINT)
        data["x"], data["y"], data["z"] = points.T
        red, green, blue = colors.T.astype(np.uint32)
        data["rgb"] = red << 16 | green << 8 | blue
        fields = [
            self._new(
                "sensor_msgs/msg/PointField", name=name, offset=4 * k, datatype=_FLOAT32, count=1
            )
            for k, name in enumerate(_POINT.names or ())
        ]
        return self._new(
            "sensor_msgs/msg/PointCloud2",
            header=self._header(stamp_ns, frame),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=_POINT.itemsize,
            row_step=data.nbytes,
            data=data.view(np.uint8),
            is_dense=True,
        )

    def occupancy_grid(
        self, stamp_ns: int, frame: str, cell_m: float, T: np.ndarray, occupied: np.ndarray
    ) -> Any:
        """`nav_msgs/OccupancyGrid` of [rows, columns] int8: 0 free to 100 occupied, -1 unknown.

        T: pose [4, 4] of the corner of cell [0, 0] in `frame`; columns go along its x, rows along its y.
        """
        rows, columns = occupied.shape
        time = self._time(stamp_ns)
        info = self._new(
            "nav_msgs/msg/MapMetaData",
            map_load_time=time,
            resolution=cell_m,
            width=columns,
            height=rows,
            origin=self._pose(T),
        )
        return self._new(
            "nav_msgs/msg/OccupancyGrid",
            header=self._header(stamp_ns, frame),
            info=info,
            data=np.ascontiguousarray(occupied, np.int8).ravel(),
        )

    def distance_slice(
        self,
        stamp_ns: int,
        frame: str,
        cell_m: float,
        corner: np.ndarray,
        distance_m: np.ndarray,
        unknown: float,
    ) -> Any:
        """`nvblox_msgs/DistanceMapSlice` of distances [rows, columns] m; nan becomes `unknown`.

        corner: [3] m, corner of cell [0, 0] in `frame` at the height of the slice; columns go along x of
        `frame`, rows along y.
        """
        rows, columns = distance_m.shape
        known = np.where(np.isnan(distance_m), unknown, distance_m)
        x, y, z = map(float, corner)
        return self._new(
            "nvblox_msgs/msg/DistanceMapSlice",
            header=self._header(stamp_ns, frame),
            resolution=cell_m,
            width=columns,
            height=rows,
            origin=self._new("geometry_msgs/msg/Point", x=x, y=y, z=z),
            unknown_value=unknown,
            data=known.astype(np.float32).ravel(),
        )

    def _new(self, kind: str, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _time(self, stamp_ns: int) -> Any:
        """The time, clamped to the range of ROS: a source may have any stamps."""
        seconds, nanoseconds = divmod(min(max(stamp_ns, 0), _LATEST_NS), 10**9)
        return self._new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)

    def _header(self, stamp_ns: int, frame: str) -> Any:
        return self._new("std_msgs/msg/Header", stamp=self._time(stamp_ns), frame_id=frame)

    def _vector(self, v: np.ndarray) -> Any:
        x, y, z = map(float, v)
        return self._new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _quaternion(self, T: np.ndarray) -> Any:
        x, y, z, w = map(float, quaternion_from_rotation(T[:3, :3]))
        return self._new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _pose(self, T: np.ndarray) -> Any:
        x, y, z = map(float, T[:3, 3])
        position = self._new("geometry_msgs/msg/Point", x=x, y=y, z=z)
        orientation = self._quaternion(T)
        return self._new("geometry_msgs/msg/Pose", position=position, orientation=orientation)

    def _uncertain_pose(self, T: np.ndarray, covariance: np.ndarray | None) -> Any:
        numbers = _row_by_row(covariance)
        pose = self._pose(T)
        return self._new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=numbers)


def _row_by_row(covariance: np.ndarray | None) -> np.ndarray:
    """Covariance [36] of [6, 6], never singular; large if it is unknown (None)."""
    known = _UNKNOWN * np.eye(6) if covariance is None else covariance + _SURE * np.eye(6)
    return known.ravel()
