"""Faults of full shared memory or a full keyframe store."""

import contextlib
import threading
import time
from dataclasses import replace
from pathlib import Path

from hsslam_bench.faults.experiment import Experiment, with_shared_memory
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.faults.strange_frames import NO_SHARED_MEMORY, small_room_frames
from hsslam_bench.runs.live_run import SENT_ROOM, SMALL_ROOM, LiveRun
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import read_tum
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_message
from hsslam_services.bus.bus import Bus

_STILL_S = 120.0
_RATE_HZ = 20.0
_LEAST_SHARE = 0.5  # of the frames must have a pose
_SETTLED_S = 20.0
_MOST_MB_PER_S = 0.02
_FEW_KEYFRAMES, _FRAMES = ("--slam.keyframes.capacity", "12"), 300


def camera_stands_still(experiment: Experiment) -> Finding:
    """Send one frame for two minutes, with /dev/shm of 256 MB; expect poses and no growth of memory."""
    (frame,) = small_room_frames(1)
    run = experiment.serve(
        *SENT_ROOM,
        "--slam.keyframes.every-frames",
        "1",
        prefix=with_shared_memory("256m"),
    )
    run.wait_until_ready()
    stopped = threading.Event()
    camera = threading.Thread(target=_publish, args=(run, frame, stopped), daemon=True)
    camera.start()
    samples: list[tuple[float, float]] = []
    poses = 0
    begin_s = time.monotonic()
    while run.code is None and (now_s := time.monotonic() - begin_s) < _STILL_S:
        samples.append((now_s, _used_mb(run)))
        poses = len(run.new_poses())
        time.sleep(1.0)
    code = run.code
    stopped.set()
    camera.join()
    late = [sample for sample in samples if sample[0] > _SETTLED_S]
    grown = (late[-1][1] - late[0][1]) / (late[-1][0] - late[0][0]) if len(late) > 1 else 0.0
    if code is None:
        run.signal()
        run.finish()
        if poses == 0 or not all(used_mb for _, used_mb in samples):
            raise CouldNotTellError(f"{poses} poses; memory by time, s and MB: {samples}")
    return Finding(
        code is not None or grown > _MOST_MB_PER_S or poses < _LEAST_SHARE * _RATE_HZ * _STILL_S,
        f"shared memory grew by {grown:.3f} MB/s after {_SETTLED_S:g} s; {poses} poses; ended by itself: "
        f"{code}",
    )


def map_is_saved_without_room(experiment: Experiment) -> Finding:
    """Fill /dev/shm with another file, then save the map; expect that the run continues."""
    maps = experiment.folder / "maps"
    run = experiment.serve(
        *SMALL_ROOM,
        *("--synth.length", "3000", "--maps", str(maps)),
        prefix=with_shared_memory("700m"),
    )
    run.wait_for_poses(40)
    filler = _shared_memory(run) / "filler"
    with filler.open("wb", buffering=0) as file:
        for size in (1 << 20, 4096, 1):
            with contextlib.suppress(OSError):
                while True:
                    file.write(bytes(size))
    answer = run.control("save", "mine")
    code = run.ends_within(10.0)
    filler.unlink()
    if code is None:
        run.signal()
        run.finish()
    lost = run.missing("trajectory.txt")
    return Finding(
        code is not None or bool(lost),
        f"save: {answer[:120]!r}; ended by itself: {code}; not written: {lost or 'nothing'}",
    )


def keyframes_reach_their_capacity(experiment: Experiment) -> Finding:
    """A store for 12 keyframes; expect a pose for every frame, and one notice."""
    frames = ("--frames", str(_FRAMES), "--pace", "lockstep")
    run = experiment.serve(*SMALL_ROOM, *_FEW_KEYFRAMES, *frames)
    code = run.ends_within(240.0)
    answered = len(read_tum(run.out / "trajectory.txt")) if code == 0 else 0
    notices = sum("there is room for" in line for line in run.stderr.splitlines())
    return Finding(
        code != 0 or answered < _FRAMES or notices != 1,
        f"exit code {code}; {answered} of {_FRAMES} frames have a pose; {notices} notices",
    )


def _publish(run: LiveRun, frame: Frame, stopped: threading.Event) -> None:
    with Bus(run.endpoint, "robot", "camera-still", settings=NO_SHARED_MEMORY) as bus:
        publisher, index = bus.publisher(topics.FRAME), 0
        while not stopped.wait(1 / _RATE_HZ):
            stamp_ns = round(index * 1e9 / _RATE_HZ)
            still = replace(frame, index=index, stamp_ns=stamp_ns)
            publisher.put(frame_message(still, time.time_ns()))
            index += 1


def _shared_memory(run: LiveRun) -> Path:
    """The /dev/shm of the service."""
    return Path(f"/proc/{run.process.pid}/root/dev/shm")


def _used_mb(run: LiveRun) -> float:
    """Disk use of the service's /dev/shm, MB; 0 if the folder is not visible."""
    blocks = 0
    for path in _shared_memory(run).rglob("*"):
        with contextlib.suppress(FileNotFoundError):  # just removed
            blocks += path.stat().st_blocks
    return blocks * 512 / 1e6
