"""Odometry of another program on `in/odometry` comes with the frames of the run's camera."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse, quaternion_from_rotation
from hsslam_node.odometry.noise import USUAL_NOISE
from hsslam_node.odometry.reading import OdometryReading
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Report
from hsslam_node.sources.synth import synth_truth
from hsslam_proto import topics
from hsslam_proto.messages import RobotOdometry
from hsslam_proto.pose_codec import pose_matrix
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.odometry_inlet import OdometryInlet
from hsslam_services.bus.publisher import Publisher
from tests.services.serve_process import SMALL_ROOM

_CAMERA = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
_FRAME = Frame(0, 5, _CAMERA, np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.uint16), 1000.0)
_START_NS = 1_700_000_000_000_000_000
_AHEAD = (0.3, 0.0, 0.2, -0.5, 0.5, -0.5, 0.5)  # 30 cm before the base, looking ahead
_FRAMES, _COVERED = 50, range(20, 35)
_PERIOD_NS = 1_000_000_000 // 15  # of SMALL_ROOM


def test_a_frame_gets_what_wheels_say_at_its_wall_clock(endpoint):
    with Bus(endpoint, "r", "outside") as outside, Bus(endpoint, "r", "camera") as camera:
        inlet = OdometryInlet(camera.subscribe(topics.ODOMETRY, 64), _AHEAD, USUAL_NOISE)
        wheels = outside.publisher(topics.ODOMETRY)
        last = _START_NS + 400_000_000
        assert inlet.given(_FRAME, last).odometry is None
        _wait_for(wheels.has_subscribers)
        for k in range(21):  # 0.5 m/s ahead, until a frame has the last of it
            stamp_ns = _START_NS + 20_000_000 * k
            t = (0.5 * 0.02 * k, 1.0, 0.0)
            wheels.put(RobotOdometry(stamp_ns=stamp_ns, t=t, q=(0.0, 0.0, 0.0, 1.0)))
        _wait_for(lambda: inlet.given(_FRAME, last).odometry is not None)
        given = inlet.given(_FRAME, last)
        between = inlet.given(_FRAME, _START_NS + 110_000_000).odometry
        assert between is not None and given.odometry is not None
        for reading, seconds in ((between, 0.11), (given.odometry, 0.4)):
            centre_m = reading.T_odom_cam[:3, 3]
            np.testing.assert_allclose(centre_m, [0.3 + 0.5 * seconds, 1.0, 0.2], atol=1e-9)
        own = OdometryReading.at(np.eye(4))
        kept = Frame(**{**vars(_FRAME), "odometry": own})
        assert inlet.given(kept, last).odometry is own


@dataclass(frozen=True)
class _Connected:
    """Wheels and the inlet that hears them; `told`: its reports."""

    wheels: Publisher[RobotOdometry]
    inlet: OdometryInlet
    told: list[Report]

    def send(self, stamp_ns: int, x: float = 0.0) -> None:
        q = (0.0, 0.0, 0.0, 1.0)
        self.wheels.put(RobotOdometry(stamp_ns=stamp_ns, t=(x, 0.0, 0.0), q=q))

    def wait_for_odometry(self, stamp_ns: int) -> None:
        _wait_for(lambda: self.inlet.given(_FRAME, stamp_ns).odometry is not None)


@pytest.fixture
def connected(endpoint) -> Iterator[_Connected]:
    told: list[Report] = []
    with Bus(endpoint, "r", "outside") as outside, Bus(endpoint, "r", "camera") as camera:
        messages = camera.subscribe(topics.ODOMETRY, 64)
        inlet = OdometryInlet(messages, _AHEAD, USUAL_NOISE, told.append)
        wheels = outside.publisher(topics.ODOMETRY)
        _wait_for(wheels.has_subscribers)
        yield _Connected(wheels, inlet, told)


def test_a_clock_that_was_set_back_is_told(connected):
    for stamp_ns in (_START_NS + 9_000_000_000, _START_NS):
        connected.send(stamp_ns)
    connected.wait_for_odometry(_START_NS)
    told = connected.told
    assert [report.kind for report in told] == ["in/odometry: clock set back"]
    assert "set back by 9.0 s" in told[0].text


def test_a_position_that_is_no_reading_is_left_out_and_reported(connected):
    for k, x in enumerate((0.0, 1e29, 0.0)):
        connected.send(_START_NS + 20_000_000 * k, x)
    connected.wait_for_odometry(_START_NS + 40_000_000)
    reports = connected.told
    assert [report.kind for report in reports] == ["in/odometry: unusable messages"]
    assert "expected at most 1e+08 m" in reports[0].text


def _wait_for(is_done: Callable[[], bool]) -> None:
    given_up_s = time.monotonic() + 20
    while not is_done():
        assert time.monotonic() < given_up_s
        time.sleep(0.01)


@pytest.mark.e2e
@pytest.mark.long
def test_a_run_whose_lens_is_covered_goes_on_by_what_another_program_sends(serve):
    """The program knows how the camera moves, and sends that a few frames ahead."""
    lens = ("--cover-at", str(_COVERED.start), "--cover-frames", str(len(_COVERED)))
    mounted = ("--base-T-camera", "0", "0", "0", "0", "0", "0", "1")
    run = serve(*SMALL_ROOM, "--frames", str(_FRAMES), *lens, *mounted)
    truth = synth_truth("room", SourceOptions(frames=_FRAMES))[0].T_world_cam
    assert run.bus.is_connected()
    with Bus(run.endpoint, "robot", "outside") as outside:
        wheels = outside.publisher(topics.ODOMETRY)
        sent = 0

        def has_ended() -> bool:
            nonlocal sent
            pose = run.new_poses()[-1] if run.new_poses() else None
            if pose is None or pose.index == 0:  # from the second frame on the clock runs evenly
                return False
            ahead = min(pose.index + 5, _FRAMES)
            for k in range(max(sent, pose.index), ahead):
                stamp_ns = pose.stamp_ns + (k - pose.index) * _PERIOD_NS
                x, y, z = truth[k][:3, 3].tolist()
                q = tuple(quaternion_from_rotation(truth[k][:3, :3]).tolist())
                wheels.put(RobotOdometry(stamp_ns=stamp_ns, t=(x, y, z), q=q))
            sent = max(sent, ahead)
            return pose.index == _FRAMES - 1

        run.wait_until(has_ended, 180)
    assert run.finish() == 0, run.stderr
    assert not [pose.index for pose in run.poses if pose.status == "lost"]
    dark = [pose for pose in run.poses if pose.index in _COVERED]
    assert len(dark) > 5 and all(pose.is_dead_reckoned for pose in dark)
    assert not any(pose.is_dead_reckoned for pose in run.poses if pose.index not in _COVERED)
    first = run.poses[0]
    for pose in dark:
        T = inverse(pose_matrix([*first.t, *first.q])) @ pose_matrix([*pose.t, *pose.q])
        off = inverse(inverse(truth[first.index]) @ truth[pose.index]) @ T
        assert np.linalg.norm(off[:3, 3]) < 0.02
