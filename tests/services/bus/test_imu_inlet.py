"""Samples of an IMU of another program on `in/imu` come, integrated, with the frames of the run's camera."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import so3_exp
from hsslam_node.inertial.reading import motion_between
from hsslam_node.sources.reports import Report
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_from_message, frame_message
from hsslam_proto.messages import ImuSamples
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.imu_inlet import ImuInlet

_CAMERA = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
_FRAME = Frame(0, 5, _CAMERA, np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.uint16), 1000.0)
_START_NS = 1_700_000_000_000_000_000
_ON_ITS_SIDE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.7071067811865476, 0.7071067811865476)


def test_a_frame_gets_what_the_imu_has_integrated_at_its_wall_clock(endpoint):
    """The camera turns about its x at 0.5 rad/s, which is the IMU's -y."""
    with Bus(endpoint, "r", "outside") as outside, Bus(endpoint, "r", "camera") as camera:
        inlet = ImuInlet(camera.subscribe(topics.IMU, 64), _ON_ITS_SIDE)
        imu = outside.publisher(topics.IMU)
        first_ns, last_ns = _START_NS + 33_000_000, _START_NS + 400_000_000
        assert inlet.given(_FRAME, last_ns).imu is None
        _wait_for(imu.has_subscribers)
        for k in range(0, 84, 4):  # four samples in a message, 200 a second
            stamps_ns = [_START_NS + 5_000_000 * n for n in range(k, k + 4)]
            rates, forces = [(0.0, -0.5, 0.0)] * 4, [(9.81, 0.0, 0.0)] * 4
            imu.put(ImuSamples(stamps_ns=stamps_ns, angular_velocity=rates, acceleration=forces))
        _wait_for(lambda: inlet.given(_FRAME, last_ns).imu is not None)
        last = inlet.given(_FRAME, last_ns)
        first = inlet.given(_FRAME, first_ns)
        own = replace(_FRAME, imu=first.imu)
        assert inlet.given(own, last_ns) is own
    motion = motion_between(first.imu, last.imu)
    assert motion is not None and motion.seconds == 0.367
    np.testing.assert_allclose(motion.rotation, so3_exp(np.array([0.1835, 0.0, 0.0])), atol=1e-9)
    came = frame_from_message(frame_message(last, last_ns)).imu
    assert came is not None and last.imu is not None and came.series == last.imu.series
    np.testing.assert_array_equal(came.numbers, last.imu.numbers)


def test_a_sample_that_is_no_reading_is_left_out_and_reported(endpoint):
    reports: list[Report] = []
    with Bus(endpoint, "r", "outside") as outside, Bus(endpoint, "r", "camera") as camera:
        inlet = ImuInlet(camera.subscribe(topics.IMU, 64), _ON_ITS_SIDE, reports.append)
        imu = outside.publisher(topics.IMU)
        _wait_for(imu.has_subscribers)
        stamps_ns = [_START_NS, _START_NS + 5_000_000, _START_NS + 10_000_000]
        forces = [(9.81, 0.0, 0.0), (1e29, 0.0, 0.0), (9.81, 0.0, 0.0)]
        rates = [(0.0, 0.0, 0.0)] * 3
        imu.put(ImuSamples(stamps_ns=stamps_ns, angular_velocity=rates, acceleration=forces))
        _wait_for(lambda: inlet.given(_FRAME, stamps_ns[2]).imu is not None)
    assert [report.kind for report in reports] == ["in/imu: unusable messages"]
    assert "expected at most" in reports[0].text


def _wait_for(is_done: Callable[[], bool]) -> None:
    given_up_s = time.monotonic() + 20
    while not is_done():
        assert time.monotonic() < given_up_s
        time.sleep(0.01)
