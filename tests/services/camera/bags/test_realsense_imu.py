"""The IMU of a recording of the RealSense viewer: gyroscope and accelerometer are topics of their own."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hsslam_node.geometry.se3 import inverse, so3_exp, transform
from hsslam_node.inertial.reading import motion_between
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.topics import BagOptions
from hsslam_node.sources.reports import reports_of
from tests.services.camera.bags.room_bags import ROOM, opened, whole_frames
from tests.services.camera.bags.ros_bags import new_bag

_DEPTH, _COLOR = "/device_0/sensor_0/Depth_0", "/device_0/sensor_1/Color_0"
_GYROSCOPE, _ACCELEROMETER = (f"/device_0/sensor_2/{name}_0" for name in ("Gyro", "Accel"))
_START_NS = 1_000_000_000
_TURN_RATE, _LESS = 0.3, 2.0  # rad/s about y; m/s^2 each second, by which the acceleration falls
_ON_ITS_HEAD = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # T_color_imu
_HALF = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5**0.5, 0.5**0.5])


def _recorded(path: Path, *, T_imu: Sequence[float] | None, parts: str = "both") -> Path:
    """Frames of the room; a camera that turns about its y, with an IMU on its head.

    T_imu: pose of the reference of the streams in the axes of the IMU; None: the recording has none.
    """
    with new_bag(path, "bag") as bag:
        if T_imu is not None:
            T_color = transform(np.zeros(3), _HALF[3:])
            bag.transform(f"{_COLOR}/tf/0", 1, _numbers(T_color))
            bag.transform(f"{_GYROSCOPE}/tf/0", 1, T_imu)
        # on the wire the numbers of the other part are 0
        for k in range(80):
            bag.imu(
                f"{_GYROSCOPE}/imu/data", 900_000_000 + 5_000_000 * k, (0, -_TURN_RATE, 0), (0,) * 3
            )
        for k in range(26 if parts == "both" else 0):
            stamp_ns = 893_000_000 + 16_000_000 * k
            force = 9.81 - _LESS * 1e-9 * (stamp_ns - _START_NS)
            bag.imu(f"{_ACCELEROMETER}/imu/data", stamp_ns, (0,) * 3, (0, force, 0))
        bag.recorded_later_ns = 40_000_000  # exposed and transferred
        for frame in open_source("synth:room", ROOM).frames():
            stamp_ns = _START_NS + frame.stamp_ns
            bag.info(f"{_COLOR}/info/camera_info", stamp_ns, frame.camera)
            bag.image(f"{_COLOR}/image/data", stamp_ns, frame.color, "rgb8")
            bag.image(f"{_DEPTH}/image/data", stamp_ns, frame.depth_raw, "mono16")
    return path


def _numbers(T: np.ndarray) -> list[float]:
    return [*T[:3, 3].tolist(), *Rotation.from_matrix(T[:3, :3]).as_quat().tolist()]


def _mounted() -> list[float]:
    """As the SDK records it: the streams' reference in the axes of the IMU."""
    T_color_imu = transform(np.zeros(3), np.array(_ON_ITS_HEAD[3:]))
    return _numbers(inverse(T_color_imu) @ transform(np.zeros(3), _HALF[3:]))


def test_its_parts_are_united_and_mounted_as_recorded(tmp_path: Path):
    mounted = _recorded(tmp_path / "viewer.bag", T_imu=_mounted())
    alone = _recorded(tmp_path / "alone.bag", T_imu=None)
    for source in (
        opened(mounted),
        opened(mounted, bag=BagOptions(imu=f"{_ACCELEROMETER}/imu/data")),
        opened(alone, camera_T_imu=_ON_ITS_HEAD),
        opened(alone, camera_T_imu=_ON_ITS_HEAD, bag=BagOptions(imu=f"{_GYROSCOPE}/imu/data")),
    ):
        frames = whole_frames(source)
        motion = motion_between(frames[0].imu, frames[5].imu)
        assert motion is not None and not reports_of(source).take()
        seconds = 1e-9 * (frames[5].stamp_ns - frames[0].stamp_ns)
        turned = so3_exp(np.array([0.0, _TURN_RATE * seconds, 0.0]))
        np.testing.assert_allclose(motion.rotation, turned, atol=1e-7)
        faster = [0.0, -(9.81 - _LESS * seconds / 2) * seconds, 0.0]
        np.testing.assert_allclose(motion.velocity_change, faster, atol=1e-6)


def test_without_a_mounting_it_is_used_if_it_is_named(tmp_path: Path):
    path = _recorded(tmp_path / "viewer.bag", T_imu=None)
    assert all(frame.imu is None for frame in whole_frames(opened(path)))
    frames = whole_frames(opened(path, bag=BagOptions(imu=f"{_GYROSCOPE}/imu/data")))
    motion = motion_between(frames[0].imu, frames[5].imu)
    assert motion is not None and motion.velocity_change[1] > 1.5  # in the axes of the IMU


def test_a_mounting_that_is_not_valid_is_reported(tmp_path: Path):
    source = opened(_recorded(tmp_path / "viewer.bag", T_imu=[0.0] * 7))
    (report,) = reports_of(source).take()
    assert report.text.startswith(f"{_GYROSCOPE}/imu/data: mounting: 0 0 0 0 0 0 0: expected")
    assert all(frame.imu is None for frame in whole_frames(source))


@pytest.mark.parametrize("options", [{}, {"camera_T_imu": _ON_ITS_HEAD}])
def test_a_gyroscope_alone_has_no_accelerations(options, tmp_path: Path):
    """It is no IMU by default; if an option asks for it, gravity stays unknown."""
    path = _recorded(tmp_path / "viewer.bag", T_imu=_mounted(), parts="gyroscope")
    frames = whole_frames(opened(path, **options))
    assert [frame.imu is not None for frame in frames] == [bool(options)] * 6
