"""Odometry and IMU of bags come with the frames, at their time and in the axes of the camera."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.doctor.examine import examine
from hsslam_node.doctor.sample import take_sample
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import so3_exp
from hsslam_node.inertial.reading import motion_between
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.topics import BagOptions
from hsslam_node.sources.reports import reports_of
from hsslam_node.sources.source import Source
from hsslam_services.camera.open_source import open_any_source
from tests.services.camera.bags.room_bags import ROOM, opened, whole_frames
from tests.services.camera.bags.ros_bags import KINDS, BagWriter, new_bag, written


@pytest.fixture(scope="module")
def room() -> list[Frame]:
    return whole_frames(open_source("synth:room", ROOM))


@pytest.mark.parametrize("kind", KINDS)
def test_odometry_of_a_bag_comes_with_its_frames(kind: str, room: list[Frame], tmp_path: Path):
    """A base that drives ahead at 0.5 m/s, 50 messages a second from 0.1 s before the first frame on."""
    rooms = [replace(frame, stamp_ns=frame.stamp_ns + 1_000_000_000) for frame in room]

    def drive(bag: BagWriter) -> None:
        for k in range(15):
            stamp_ns = 900_000_000 + 20_000_000 * k
            bag.odometry("/odom", stamp_ns, (0.5e-9 * stamp_ns, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))

    path = written(tmp_path, kind, rooms, drive)
    for first in (0, 4):
        source = opened(path, bag=BagOptions(odometry="/odom"))
        for frame in whole_frames(source, first):
            assert frame.odometry is not None
            centre_m = frame.odometry.T_odom_cam[:3, 3]
            np.testing.assert_allclose(centre_m, [0.5e-9 * frame.stamp_ns, 0.0, 0.0], atol=1e-9)
    assert all(frame.odometry is None for frame in whole_frames(opened(path)))
    with pytest.raises(UserError, match=r"--bag\.odometry /wheels: no such topic.*/odom \(Odom"):
        opened(path, bag=BagOptions(odometry="/wheels"))


@pytest.mark.parametrize("kind", KINDS)
def test_an_imu_of_a_bag_is_used_if_its_mounting_is_known(
    kind: str, room: list[Frame], tmp_path: Path
):
    """A camera that turns about its y at 0.3 rad/s; the IMU stands on its head."""
    rooms = [replace(frame, stamp_ns=frame.stamp_ns + 1_000_000_000) for frame in room]

    on_its_head = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)

    def turn_as_tf_has_it(bag: BagWriter) -> None:
        """Both are mounted on a plate; camera and IMU are turned by half of it each."""
        half = (0.0, 0.0, 0.0, 0.0, 0.0, 0.5**0.5, 0.5**0.5)
        back = (0.0, 0.0, 0.0, 0.0, 0.0, -(0.5**0.5), 0.5**0.5)
        bag.static_transforms(900_000_000, [])
        bag.static_transforms(900_000_000, [("plate", "camera", back), ("plate", "imu", half)])
        _turn_on_its_head(bag)

    path = written(tmp_path, kind, rooms, _turn_on_its_head)
    (tmp_path / "tf").mkdir()
    with_tf = written(tmp_path / "tf", kind, rooms, turn_as_tf_has_it)
    for source in (
        opened(path, camera_T_imu=on_its_head),
        opened(path, camera_T_imu=on_its_head, bag=BagOptions(imu="/imu/data")),
        opened(with_tf, bag=BagOptions(imu="/imu/data")),
        opened(with_tf, camera_T_imu=on_its_head),
    ):
        frames = whole_frames(source)
        motion = motion_between(frames[0].imu, frames[4].imu)
        assert motion is not None
        seconds = 1e-9 * (frames[4].stamp_ns - frames[0].stamp_ns)
        turned = so3_exp(np.array([0.0, 0.3 * seconds, 0.0]))
        np.testing.assert_allclose(motion.rotation, turned, atol=1e-7)
        assert motion.velocity_change[1] == pytest.approx(-9.81 * seconds, rel=0.01)
    assert all(frame.imu is None for frame in whole_frames(opened(path)))
    with pytest.raises(UserError, match=r"--bag\.imu /imu: no such topic.*/imu/data \(Imu"):
        opened(path, bag=BagOptions(imu="/imu"))


@pytest.mark.parametrize("kind", KINDS)
def test_a_topic_of_a_sensor_without_messages_is_one_line(
    kind: str, room: list[Frame], tmp_path: Path
):
    def silent(bag: BagWriter) -> None:
        bag.announce("/odom", "nav_msgs/msg/Odometry")
        bag.announce("/imu/data", "sensor_msgs/msg/Imu")

    path = written(tmp_path, kind, room, silent)
    for options in (BagOptions(odometry="/odom"), BagOptions(imu="/imu/data")):
        with pytest.raises(UserError, match=r"no such topic.*/odom \(Odometry, no messages\)"):
            opened(path, bag=options)


def _turn_on_its_head(bag: BagWriter) -> None:
    for k in range(80):
        bag.imu("/imu/data", 900_000_000 + 5_000_000 * k, (0.0, -0.3, 0.0), (0.0, 9.81, 0.0))


def test_a_static_transform_that_is_none_is_one_line(room: list[Frame], tmp_path: Path):
    """The camera's frames are not lost for it."""

    def put(bag: BagWriter) -> None:
        _turn_on_its_head(bag)
        bag.static_transforms(900_000_000, [("camera", "imu", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0))])

    path = written(tmp_path, KINDS[0], room, put)
    source = opened(path, bag=BagOptions(imu="/imu/data"))
    (report,) = reports_of(source).take()
    expected = "/tf_static: camera to imu: 0 0 0 0 0 0 2: expected x y z and a unit quaternion"
    assert report.text.startswith(expected)
    assert len(whole_frames(source)) == len(room)
    assert all(frame.imu is None for frame in whole_frames(opened(path)))


def _with_odometry(path: Path, room: list[Frame], at: Callable[[int], tuple[float, ...]]) -> Source:
    """The bag of the room with 50 messages a second, from its first frame's stamp on."""
    with new_bag(path, "mcap") as bag:
        for frame in room:
            for stamp_ns in range(frame.stamp_ns, frame.stamp_ns + 33_000_000, 10_000_000):
                bag.odometry("/odom", stamp_ns, at(stamp_ns))
            bag.frame(frame)
    return opened(path, bag=BagOptions(odometry="/odom"))


@pytest.mark.parametrize("bad", [(0.0,) * 7, (np.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)])
def test_an_odometry_message_that_cannot_be_used_costs_no_frame(bad, room, tmp_path: Path):
    still = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    worst_ns = room[3].stamp_ns
    source = _with_odometry(tmp_path / "bag", room, lambda ns: bad if ns == worst_ns else still)
    frames = whole_frames(source)
    assert [frame.odometry is not None for frame in frames] == [True] * 6
    (report,) = reports_of(source).take()
    assert report.kind == "/odom: unusable messages"
    assert report.text.startswith("/odom: odometry: position [")
    assert not reports_of(source).take()


def test_odometry_that_is_never_usable_costs_no_frame(room, tmp_path: Path):
    source = _with_odometry(tmp_path / "bag", room, lambda _: (0.0,) * 7)
    asked = SourceOptions(bag=BagOptions(odometry="/odom"))
    sample = take_sample(f"bag:{tmp_path / 'bag'}", asked, 6, open_any_source)
    (found,) = (f for f in examine(sample, None) if f.name == "sensors")
    assert found.severity == "note" and found.seen.startswith("/odom: odometry: position [")
    assert all(frame.odometry is None for frame in whole_frames(source))
    assert len(reports_of(source).take()) > 6


def test_a_bag_of_a_clock_that_was_set_back_has_the_odometry_of_each_run(room, tmp_path: Path):
    """The robot drives, the simulator is reset, and the robot stands."""
    moved = [replace(f, stamp_ns=f.stamp_ns + (k >= 3) * 2_000_000_000) for k, f in enumerate(room)]
    with new_bag(tmp_path / "bag", "mcap") as bag:
        for run, speed_m_s in enumerate((1.0, 0.0)):
            bag.recorded_later_ns = run * 5_000_000_000
            for frame in moved:
                at_m = 1e-9 * frame.stamp_ns * speed_m_s
                bag.odometry("/odom", frame.stamp_ns, (at_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
                bag.frame(frame)
    ahead = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    source = opened(tmp_path / "bag", base_T_camera=ahead, bag=BagOptions(odometry="/odom"))
    second = whole_frames(source)[6:]
    assert [f.odometry.numbers[0] for f in second if f.odometry is not None] == [0.0] * 6
    (report,) = reports_of(source).take()
    assert report.text.startswith("/odom: clock set back by 2.2 s")
