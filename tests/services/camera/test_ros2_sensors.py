"""Odometry and IMU of ROS 2 beside the images of a camera, over real zenoh sessions."""

import itertools
import threading
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import so3_exp, transform
from hsslam_node.inertial.reading import motion_between
from hsslam_node.sources.reports import reports_of
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.names import Qos
from hsslam_services.ros2.node import RosNode
from tests.services.camera.ros_camera import FIRST_NS, RosCamera, imu, odometry, ros2_options


def test_odometry_of_wheels_comes_with_the_frames(endpoint, ros_camera, room):
    """The base drives ahead at 0.3 m/s, its camera looks to the right from 20 cm before its centre."""
    mount = (0.2, 0.0, 0.4, 0.0, -0.7071067811865476, 0.7071067811865476, 0.0)

    ended = threading.Event()

    def drive() -> None:
        every_ns = 100_000_000
        for k in range(-2, 4000):  # 20 s at once, as the camera has begun; then at their rate
            way_m = 0.3e-9 * k * every_ns
            message = odometry(FIRST_NS + k * every_ns, (way_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            ros_camera.put("/wheels/odom", message, "Odometry")
            if k > 200 and ended.wait(0.1):
                return

    asked = ros2_options(endpoint, 200, timeout_s=2.0, odometry="/wheels/odom")
    ros_camera.start(room)
    with pytest.raises(UserError, match=r"no odometry within 2 s on /wheels/odom: expected nav"):
        open_any_source("ros2:/camera", asked)
    again = open_any_source("ros2:/camera", replace(asked, is_reopened=True))
    (told,) = reports_of(again).take()
    assert told.text.startswith("/wheels/odom: silent since the camera is opened again")
    frames = again.frames()
    assert isinstance(next(frames), Frame)
    frames.close()
    asked = replace(asked, base_T_camera=mount, ros2=replace(asked.ros2, timeout_s=10.0))
    driving = threading.Timer(0.3, drive)
    driving.start()
    try:
        frames = open_any_source("ros2:/camera", asked).frames()
        given = (f for f in frames if isinstance(f, Frame) and f.odometry is not None)
        moved = list(itertools.islice(given, 5))
    finally:
        ended.set()
        driving.join()
    assert len(moved) == 5
    for frame in moved:
        assert frame.odometry is not None
        seconds = 1e-9 * (frame.stamp_ns - FIRST_NS)
        T_odom_cam = frame.odometry.T_odom_cam
        np.testing.assert_allclose(T_odom_cam[:3, 3], [0.2 + 0.3 * seconds, 0.0, 0.4], atol=1e-6)
        np.testing.assert_allclose(T_odom_cam[:3, 2], [0.0, -1.0, 0.0], atol=1e-6)


def test_sensors_may_send_more_rarely_than_a_camera_that_is_opened_again(
    endpoint, ros_camera, room
):
    ended = threading.Event()

    def drive() -> None:
        for k in itertools.count():
            if ended.wait(0.5):
                return
            stamp_ns = FIRST_NS + k * 500_000_000
            stands = odometry(stamp_ns, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            ros_camera.put("/odom", stands, "Odometry")

    ros_camera.start(room)
    driving = threading.Thread(target=drive)
    driving.start()
    try:
        asked = replace(ros2_options(endpoint, 1, odometry="/odom"), is_reopened=True)
        source = open_any_source("ros2:/camera", asked)
        frames = list(source.frames())
    finally:
        ended.set()
        driving.join()
    assert len(frames) == 1 and not reports_of(source).take()


def _put_imu(camera: RosCamera, ended: threading.Event, rates, forces, **more) -> None:
    """100 samples a second: two seconds at once, then as they come."""
    for k in range(-10, 4000):
        camera.put("/camera/imu", imu(FIRST_NS + k * 10_000_000, rates, forces, **more), "Imu")
        if k > 200 and ended.wait(0.01):
            return


def _expect_turned(first: Frame, last: Frame) -> None:
    """About the camera's y at 0.2 rad/s."""
    motion = motion_between(first.imu, last.imu)
    assert motion is not None
    seconds = 1e-9 * (last.stamp_ns - first.stamp_ns)
    turned = so3_exp(np.array([0.0, 0.2 * seconds, 0.0]))
    np.testing.assert_allclose(motion.rotation, turned, atol=1e-6)
    assert motion.velocity_change[1] == pytest.approx(-9.81 * seconds, rel=0.01)


def test_an_imu_comes_with_the_frames_and_one_of_half_the_numbers_is_refused(
    endpoint, ros_camera, room
):
    """The camera turns about its y at 0.2 rad/s; the IMU has its axes, and sends 100 samples a second."""
    rates, forces = (0.0, 0.2, 0.0), (0.0, -9.81, 0.0)
    ended = threading.Event()

    def turn(of_rates: float) -> None:
        _put_imu(ros_camera, ended, rates, forces, of_rates=of_rates)

    ros_camera.start(room)
    asked = ros2_options(endpoint, 200, timeout_s=1.0, imu="imu")
    halves = threading.Timer(0.3, lambda: turn(-1.0))
    halves.start()
    with pytest.raises(
        UserError, match=r"no imu .* /camera/imu; .*no angular velocity.*expected se"
    ):
        open_any_source("ros2:/camera", asked)
    ended.set()
    halves.join()
    ended.clear()
    turning = threading.Timer(0.3, lambda: turn(0.0))
    turning.start()
    try:
        asked = replace(asked, ros2=replace(asked.ros2, timeout_s=10.0))
        frames = open_any_source("ros2:/camera", asked).frames()
        given = (f for f in frames if isinstance(f, Frame) and f.imu is not None)
        first, *_, last = itertools.islice(given, 5)
    finally:
        ended.set()
    _expect_turned(first, last)


def test_the_mounting_of_an_imu_is_that_of_static_transforms(endpoint, ros_camera, room):
    """A node keeps them for who comes late; the IMU stands on its head."""
    ended = threading.Event()

    def turn() -> None:
        _put_imu(ros_camera, ended, (0.0, -0.2, 0.0), (0.0, 9.81, 0.0), frame="imu")

    messages = RosMessages("kilted")
    on_its_head = transform(np.array([0.0, 0.1, 0.0]), np.array([0.0, 0.0, 1.0, 0.0]))
    with RosNode(endpoint, 0, "/robot", "state", messages) as node:
        latched = node.publisher("/tf_static", "tf2_msgs/msg/TFMessage", Qos(1, is_latched=True))
        at_optical = ("camera_link", "camera_color_optical_frame", np.eye(4))
        latched.put(messages.transforms(1, [at_optical, ("camera_link", "imu", on_its_head)]))
        ros_camera.start(room)
        turning = threading.Timer(0.3, turn)
        turning.start()
        try:
            source = open_any_source("ros2:/camera", ros2_options(endpoint, 200, imu="imu"))
            given = (f for f in source.frames() if isinstance(f, Frame) and f.imu is not None)
            first, *_, last = itertools.islice(given, 5)
        finally:
            ended.set()
    _expect_turned(first, last)
