"""Faults of a camera: it dies repeatedly or late in a recording, restarts at frame 0, or is silent."""

import contextlib
import json
import time

import cv2
import numpy as np
import psutil

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.faults.strange_frames import NO_SHARED_MEMORY, small_room_frames
from hsslam_bench.runs.live_run import SENT_ROOM, SMALL_ROOM, LiveRun
from hsslam_node.frame import Frame
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_message
from hsslam_services.bus.bus import Bus
from hsslam_services.camera.open_source import open_any_source

_GIVEN_UP_S = 90.0
_LATE, _SIZE = 600, (640, 480)
_MOST_S = 1.0  # to resume late in a recording
_OUTSIDE = 40  # frames of an external driver
_FIRST_S, _ANSWER_S = 30.0, 1.0
_SILENT_S = 15.0


def again_and_again(experiment: Experiment) -> Finding:
    """Kill the camera whenever it lives; expect an exit code on which a service manager restarts."""
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000")
    run.wait_for_poses(20)
    killed: set[int] = set()
    deadline = time.monotonic() + _GIVEN_UP_S
    while run.code is None and time.monotonic() < deadline:
        with contextlib.suppress(psutil.Error):
            pid = run.pid_of("camera")
            if pid is not None and pid not in killed:
                psutil.Process(pid).kill()
                killed.add(pid)
        time.sleep(0.05)
    code = run.finish()
    lost = run.missing("trajectory.txt", "map.safetensors")
    return Finding(
        code in (0, 2) or bool(lost),
        f"killed {len(killed)} x; exit code {code}; not written: {lost or 'nothing'}",
    )


def late_in_a_recording(experiment: Experiment) -> Finding:
    """Resume at frame 600 of a recording; expect no decoding of earlier frames."""
    folder = experiment.folder / "long"
    _write_recording(folder, 100_000)
    source = open_any_source(f"tum:{folder}")
    begin_s = time.perf_counter()
    next(iter(source.frames()))
    first_s = time.perf_counter() - begin_s
    begin_s = time.perf_counter()
    next(iter(source.frames(_LATE)))
    late_s = time.perf_counter() - begin_s
    return Finding(
        late_s > first_s + _MOST_S,
        f"frame 0 after {first_s:.2f} s, frame {_LATE} after {late_s:.2f} s",
    )


def outside_camera_starts_from_0(experiment: Experiment) -> Finding:
    """An external driver sends frames 0 to 39, restarts and sends them again; expect them tracked."""
    frames = small_room_frames(_OUTSIDE)
    run = experiment.serve(*SENT_ROOM)
    run.wait_until_ready()
    first = _sent_and_tracked(run, frames)
    second = _sent_and_tracked(run, frames)
    return Finding(
        second < 0.8 * _OUTSIDE, f"{first} of {_OUTSIDE} frames tracked, after the restart {second}"
    )


def outside_camera_is_silent(experiment: Experiment) -> Finding:
    """Send no frames for 15 s; expect that the run continues and the next frames are tracked."""
    frames = small_room_frames(2 * _OUTSIDE)
    run = experiment.serve(*SENT_ROOM)
    run.wait_until_ready()
    first = _sent_and_tracked(run, frames[:_OUTSIDE])
    time.sleep(_SILENT_S)
    if (status := run.status()) is None:
        raise CouldNotTellError(f"no answer to status: {run.last_words}")
    second = _sent_and_tracked(run, frames[_OUTSIDE:])
    run.signal()
    code = run.finish()
    return Finding(
        second < 0.8 * _OUTSIDE or status.fps > 1.0 or code != 0,
        f"{first} of {_OUTSIDE} frames tracked; after {_SILENT_S:g} s of silence status reports "
        f"{status.fps:.1f} Hz, then {second} of {_OUTSIDE} tracked; exit code {code}",
    )


def _sent_and_tracked(run: LiveRun, frames: list[Frame]) -> int:
    """Send each frame after the pose of the previous one; returns the number of tracked frames."""
    tracked = 0
    with Bus(run.endpoint, "robot", "camera", settings=NO_SHARED_MEMORY) as bus:
        publisher = bus.publisher(topics.FRAME)
        poses = bus.subscribe(topics.POSE, 64, history=False)
        bus.live_processes()  # a round trip: the router knows both
        for number, frame in enumerate(frames):
            sent_ns = time.time_ns()
            publisher.put(frame_message(frame, sent_ns))
            pose = poses.wait(_FIRST_S if number == 0 else _ANSWER_S)
            tracked += pose is not None and pose.status != "lost" and pose.stamp_ns == sent_ns
    return tracked


def _write_recording(folder, count: int) -> None:
    """Write a recording in TUM layout whose `count` frames are all the same pair of images."""
    width, height = _SIZE
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
        lines = (f"{i / 30:.6f} {kind}/0.png" for i in range(count))
        (folder / f"{kind}.txt").write_text("\n".join(lines) + "\n")
    grey = np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8)
    color = cv2.resize(grey, _SIZE, interpolation=cv2.INTER_CUBIC)
    depth = (5000 + 8.0 * color[..., 0]).astype(np.uint16)
    cv2.imwrite(str(folder / "rgb" / "0.png"), color)
    cv2.imwrite(str(folder / "depth" / "0.png"), depth)
    camera = {"width": width, "height": height, "fx": 525, "fy": 525, "cx": 319.5, "cy": 239.5}
    (folder / "camera.json").write_text(json.dumps({**camera, "depth_scale": 5000}))
