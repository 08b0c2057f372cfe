"""Frames of other cameras, restarted cameras and absurd numbers, sent to a real run."""

import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto import topics
from hsslam_proto.codec import encoding_of
from hsslam_proto.frame_codec import frame_message
from hsslam_proto.frame_order import LARGEST_STEP, new_publisher
from hsslam_proto.messages import Pose
from hsslam_proto.run_messages import SourceEnd
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.publisher import Publisher
from hsslam_services.run.run_info import RunInfo
from tests.services.serve_process import SENT_ROOM, SMALL_ROOM, ServeProcess

pytestmark = pytest.mark.e2e

_ROOM = SourceOptions(synth=SynthOptions(width_px=160, height_px=120))


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., ServeProcess]]:
    runs: list[ServeProcess] = []

    def start(*options: str) -> ServeProcess:
        runs.append(ServeProcess(tmp_path / f"run{len(runs)}", *options))
        return runs[-1]

    yield start
    for run in runs:
        run.close()


def _frames(count: int) -> list[Frame]:
    items = open_source("synth:room", replace(_ROOM, frames=count)).frames()
    return [item for item in items if isinstance(item, Frame)]


def _sender(run: ServeProcess) -> Publisher:
    """Of frames; the run is known to hear it."""
    sender = run.bus.publisher(topics.FRAME, block=True)
    run.wait_until(sender.has_subscribers, 60)
    return sender


def _answered(run: ServeProcess, publisher, frame: Frame, camera: int = 0) -> Pose:
    publisher.put(frame_message(frame, time.time_ns(), camera))
    run.wait_for_poses(1)
    return run.poses[-1]


def _refused(run: ServeProcess) -> int:
    missed = run.heartbeats("tracker", 2)[-1].topics["in/frame"]
    return missed.rejected


def test_a_camera_that_begins_anew_goes_on_being_tracked_and_old_frames_get_no_old_pose(serve):
    run = serve(*SENT_ROOM)
    run.wait_until(lambda: "tracker:running" in run.stderr and "mapper:running" in run.stderr, 60)
    frames, sender = _frames(8), _sender(run)
    first = [_answered(run, sender, frame) for frame in frames]
    assert first[-1].status == "tracked"
    again = [_answered(run, sender, frame) for frame in frames[:4]]  # counts anew, does not say so
    assert all(new.publish_ns > first[-1].publish_ns for new in again)
    assert {pose.publisher for pose in again}.isdisjoint({pose.publisher for pose in first})
    run.kill_worker("tracker")
    run.heartbeats("tracker", 3)
    camera = new_publisher()
    named = [_answered(run, sender, frame, camera) for frame in frames]
    assert {(pose.publisher, pose.index) for pose in named} == {(camera, k) for k in range(8)}
    assert all(new.publish_ns > again[-1].publish_ns for new in named)
    late = frame_message(replace(frames[0], index=3), 1, camera)
    sender.put(late)  # is another frame with the number of one that has a pose
    assert _answered(run, sender, frames[3], camera).publish_ns == named[3].publish_ns
    assert run.heartbeats("tracker", 2)[-1].counters["late frames"] == 1
    sender.put(frame_message(replace(frames[0], index=20 + LARGEST_STEP), 1, camera))
    run.wait_until(lambda: _refused(run) == 1, 30)
    for index in (2**53 + 1, -1):
        good = msgspec.msgpack.decode(msgspec.msgpack.encode(late))
        sender.put_payload(msgspec.msgpack.encode(good | {"index": index}))
    run.wait_until(lambda: _refused(run) == 3, 30)
    assert "expected at most 1048576 after the last of its camera" in run.stderr
    assert _answered(run, sender, replace(frames[0], index=8), camera).index == 8
    run.bus.publisher(topics.SOURCE_END).put(SourceEnd(frame_count=1))
    assert run.finish() == 0, run.stderr
    assert encoding_of(topics.FRAME).endswith(".v1")


def test_a_run_with_a_camera_takes_the_frames_of_no_other_and_is_ended_by_no_other(serve):
    run = serve(*SMALL_ROOM, "--synth.length", "3000")
    run.wait_for_poses(5)
    (frame,) = _frames(1)
    run.bus.publisher(topics.SOURCE_END).put(SourceEnd(frame_count=1))
    with Bus(RunInfo.read(run.out).endpoint, "robot", "stranger") as inside:  # the port takes none
        sender = inside.publisher(topics.FRAME)
        run.wait_until(sender.has_subscribers, 60)
        for k in range(10):
            sender.put(frame_message(replace(frame, index=2**52 + k), time.time_ns()))
            sender.put(frame_message(replace(frame, index=k), time.time_ns(), new_publisher()))
            time.sleep(0.03)
    run.wait_for_poses(10)
    assert len({pose.publisher for pose in run.poses}) == 1
    assert _refused(run) > 0
    assert "of another publisher than the run's camera" in run.stderr
    indices = [pose.index for pose in run.poses]
    assert max(indices) < 2**52
    run.kill_worker("tracker")
    run.kill_worker("camera")
    run.wait_for_poses(5)
    assert len({pose.publisher for pose in run.poses}) == 1  # a restarted camera goes on counting
    run.signal(signal.SIGTERM)
    assert run.finish() == 0, run.stderr
