"""Frames of other cameras, restarted cameras and absurd numbers, and messages that are no frames, sent to a
real run."""

import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
import zenoh

from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto import topics
from hsslam_proto.codec import encode, encoding_of
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


def _refused(run: ServeProcess, heartbeats: int = 2) -> int:
    missed = run.heartbeats("tracker", heartbeats)[-1].topics["in/frame"]
    return missed.rejected


def _send_what_is_no_frame(run: ServeProcess, frame: Frame) -> None:
    """Send messages that the tracker cannot read, each once it has refused those before."""
    good = encode(topics.FRAME, frame_message(frame, time.time_ns()))
    encoding, key = encoding_of(topics.FRAME), topics.FRAME.key("robot")
    nan = good.replace(_packed("fx", frame.camera.fx), _packed("fx", float("nan")))
    assert nan != good
    bad = (
        (good, encoding.replace(".v1", ".v2")),
        (good[: len(good) // 2], encoding),
        (nan, encoding),
        (bytes(4 * 2**20), encoding),
    )
    with _outsider(run.endpoint) as session:
        for count, (payload, sent_as) in enumerate(bad, 1):
            block = zenoh.CongestionControl.BLOCK
            session.put(key, payload, encoding=sent_as, congestion_control=block)
            run.wait_until(lambda count=count: _refused(run, 1) >= count, 60)
    assert _refused(run, 1) == len(bad)


def _outsider(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def _packed(name: str, value: float) -> bytes:
    return msgspec.msgpack.encode(name) + msgspec.msgpack.encode(value)


def test_a_camera_that_begins_anew_goes_on_being_tracked_and_old_frames_get_no_old_pose(serve):
    """What cannot be read is counted, and the run goes on."""
    run = serve(*SENT_ROOM)
    run.wait_until(lambda: "tracker:running" in run.stderr and "mapper:running" in run.stderr, 60)
    frames = _frames(8)
    _send_what_is_no_frame(run, frames[0])
    assert "in/frame: version 2: expected 1" in run.stderr
    sender = _sender(run)
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
