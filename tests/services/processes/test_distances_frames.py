"""Which frames the grid takes in, shown without a run."""

import os
import time
from dataclasses import replace

import msgspec
import numpy as np

from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.map.store import KeyframeStore
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_from_message
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.worker import Worker
from hsslam_services.processes import distances
from hsslam_services.processes.distances import _DistancesLoop
from tests.services.wire_samples import frame, pose
from tests.until import until


def test_a_frame_from_before_a_reset_that_is_sent_again_marks_nothing(run_info):
    """Its pose is one in the map of then."""
    run, seen = replace(run_info, supervisor_pid=os.getppid()), frame_from_message(frame(0))
    MapState(run.arena_dir).map_epoch = 1
    with Worker("distances", run) as worker, Bus(run.endpoint, run.robot, "camera") as camera:
        store = KeyframeStore.create(worker.arena, seen.camera, seen.depth_units_per_m, 16)
        store.world_frame.note_level(RobotFrames().T_base_cam)
        store.append(seen, np.eye(4))
        loop, frames = _DistancesLoop(worker), camera.publisher(topics.FRAME, block=True)
        until(frames.has_subscribers, 60)
        (images,) = worker.bus.subscriptions

        def updates(index: int, map_epoch: int) -> int:
            """Number of updates after this frame."""
            of = msgspec.structs.replace(pose(index), t=(0, 0, 0), map_epoch=map_epoch)
            frames.put(msgspec.structs.replace(frame(index), stamp_ns=of.stamp_ns))
            until(lambda: images.received > index, 60)
            loop.take(of)
            return worker.counters.get("updates", 0)

        assert [updates(0, map_epoch=0), updates(1, map_epoch=1)] == [0, 1]


def test_poses_that_come_long_after_their_frames_are_reported_once(run_info, monkeypatch):
    """As of a preset that tracks one frame in twenty."""
    monkeypatch.setattr(distances, "_LATE_S", 0.2)
    run, seen = replace(run_info, supervisor_pid=os.getppid()), frame_from_message(frame(0))
    with Worker("distances", run) as worker:
        store = KeyframeStore.create(worker.arena, seen.camera, seen.depth_units_per_m, 16)
        store.append(seen, np.eye(4))
        loop, events = _DistancesLoop(worker), worker.bus.subscribe(topics.EVENT, 16)
        began_s = time.monotonic()
        until(lambda: loop.take(pose(0)) or time.monotonic() - began_s > 0.5, 10)
        until(lambda: events.received, 60)
        told = [event.text for event in events.drain()]
    assert len(told) == 1 and told[0].startswith("no grid: poses come more than 4 frames after")
