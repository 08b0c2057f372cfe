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
from hsslam_proto.frame_order import FrameOrder, Place
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.tracker import _TrackerLoop
from hsslam_services.run.run_info import RunInfo
from hsslam_services.tracked.events import TrackingEvents

_ROOM = SourceOptions(frames=4, synth=SynthOptions(width_px=160, height_px=120))
_CAMERA = 7  # its number
_STOOD_STILL = "frames whose source_stamp_ns did not grow"


def test_a_frame_that_cannot_be_used_is_lost_in_lockstep(make_run: Callable[..., RunInfo]):
    run = make_run(pace="lockstep", slam=PRESETS["realtime"])
    frames = [item for item in open_source("synth:room", _ROOM).frames() if isinstance(item, Frame)]
    for k in (1, 2):
        frames[k] = replace(frames[k], camera=replace(frames[k].camera, fx=999.0))
    frames[3] = replace(frames[3], stamp_ns=frames[2].stamp_ns)
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
        assert worker.counters[_STOOD_STILL] == 1


def test_a_clock_of_the_source_that_stands_still_is_counted(make_run: Callable[..., RunInfo]):
    """The driver sends 0 in each frame; another camera begins wherever its own clock is."""
    run = make_run()
    with Worker("tracker", replace(run, supervisor_pid=os.getppid())) as worker:
        events = TrackingEvents(worker, SharedMap(worker.arena, worker.options.slam))
        for camera, source_ns in ((7, 5), (7, 6), (8, 0), (8, 0), (8, 0)):
            events.heard(Place("new", camera, camera, 3, 1), source_ns)
        assert worker.counters[_STOOD_STILL] == 2
