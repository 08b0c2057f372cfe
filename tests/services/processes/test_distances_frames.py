"""Which frames the grid takes in, shown without a run."""

import os
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
        loop, frames = _DistancesLoop(worker), camera.publisher(topics.FRAME)
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
