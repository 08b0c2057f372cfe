"""Odometry of another program on `in/odometry` comes with the frames of the run's camera."""

import time

import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.odometry.noise import USUAL_NOISE
from hsslam_node.odometry.reading import OdometryReading
from hsslam_proto import topics
from hsslam_proto.messages import RobotOdometry
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.odometry_inlet import OdometryInlet

_CAMERA = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
_FRAME = Frame(0, 5, _CAMERA, np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.uint16), 1000.0)
_START_NS = 1_700_000_000_000_000_000
_AHEAD = (0.3, 0.0, 0.2, -0.5, 0.5, -0.5, 0.5)  # 30 cm before the base, looking ahead


def test_a_frame_gets_what_wheels_say_at_its_wall_clock(endpoint):
    with Bus(endpoint, "r", "outside") as outside, Bus(endpoint, "r", "camera") as camera:
        inlet = OdometryInlet(camera.subscribe(topics.ODOMETRY, 64), _AHEAD, USUAL_NOISE)
        wheels = outside.publisher(topics.ODOMETRY)
        last = _START_NS + 400_000_000
        assert inlet.given(_FRAME, last).odometry is None
        for k in range(21):  # 0.5 m/s ahead, until a frame has the last of it
            stamp_ns = _START_NS + 20_000_000 * k
            t = (0.5 * 0.02 * k, 1.0, 0.0)
            wheels.put(RobotOdometry(stamp_ns=stamp_ns, t=t, q=(0.0, 0.0, 0.0, 1.0)))
        given_up_s = time.monotonic() + 20
        while (given := inlet.given(_FRAME, last)).odometry is None:
            assert time.monotonic() < given_up_s
        between = inlet.given(_FRAME, _START_NS + 110_000_000).odometry
        assert between is not None and given.odometry is not None
        for reading, seconds in ((between, 0.11), (given.odometry, 0.4)):
            centre_m = reading.T_odom_cam[:3, 3]
            np.testing.assert_allclose(centre_m, [0.3 + 0.5 * seconds, 1.0, 0.2], atol=1e-9)
        own = OdometryReading.at(np.eye(4))
        kept = Frame(**{**vars(_FRAME), "odometry": own})
        assert inlet.given(kept, last).odometry is own
