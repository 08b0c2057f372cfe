"""The tracker process: every frame gets an answer where all wait for one."""

import os
import time
from collections.abc import Callable
from dataclasses import replace

from hsslam_node.frame import Frame
from hsslam_node.map.pose_log import LOST, TRACKED, PoseLog
from hsslam_node.presets import PRESETS
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto.frame_codec import frame_message
from hsslam_proto.frame_order import FrameOrder
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.tracker import _TrackerLoop
from hsslam_services.run.run_info import RunInfo

_ROOM = SourceOptions(frames=4, synth=SynthOptions(width_px=160, height_px=120))
_CAMERA = 7  # its number


def test_a_frame_that_cannot_be_used_is_lost_in_lockstep(make_run: Callable[..., RunInfo]):
    run = make_run(pace="lockstep", slam=PRESETS["realtime"])
    frames = [item for item in open_source("synth:room", _ROOM).frames() if isinstance(item, Frame)]
    for k in (1, 2):
        frames[k] = replace(frames[k], camera=replace(frames[k].camera, fx=999.0))
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        order = FrameOrder()
        loop = _TrackerLoop(worker, order)
        for frame in frames:
            message = frame_message(frame, time.time_ns(), _CAMERA)
            place = order.place(_CAMERA, frame.index, message.stamp_ns)
            loop.take(message, time.time_ns(), place)
        loop.finish()
        rows = PoseLog(worker.arena).rows()
        assert rows["index"].tolist() == [0, 1, 2, 3]
        assert rows["status"][1:].tolist() == [LOST, LOST, TRACKED]
        assert worker.counters["unusable frames"] == 2
