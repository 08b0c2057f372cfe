"""What the distances process says of a robot whose camera looks down without `--base-T-camera`."""

import os
from dataclasses import replace

import msgspec

from hsslam_node.map.store import KeyframeStore
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_message
from hsslam_services.bus.bus import Bus
from hsslam_services.launch.worker import Worker
from hsslam_services.processes.distances import _DistancesLoop
from tests.services.wire_samples import pose
from tests.small_room import room_frames, room_poses
from tests.until import until


def test_a_tilted_map_is_told(make_run, capfd):
    run = replace(make_run(ros2_out="/hsslam"), supervisor_pid=os.getppid())
    frames, poses = room_frames(), room_poses()
    first, at = frames[0], msgspec.structs.replace(pose(0), t=(0.0, 0.0, 0.0))
    told: list[str] = []
    with Worker("distances", run) as worker, Bus(run.endpoint, run.robot, "camera") as camera:
        store = KeyframeStore.create(worker.arena, first.camera, first.depth_units_per_m, 16)
        store.world_frame.note_level(worker.options.T_level_world)
        for k in range(0, 40, 8):
            store.append(frames[k], poses[k])
        loop, images = _DistancesLoop(worker), camera.publisher(topics.FRAME, block=True)
        until(images.has_subscribers, 60)
        images.put(frame_message(first, at.stamp_ns))

        def is_told() -> bool:
            loop.take(at)
            told.extend(capfd.readouterr().err.splitlines())
            return any("grid: direction up by level camera: " in line for line in told)

        until(is_told, 60)
    (warning,) = (line for line in told if line.startswith("warning: "))
    assert warning.startswith(
        "warning: grid: direction up by level camera is 12 degrees off that by"
    )
