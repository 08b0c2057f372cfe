"""Faults of invalid frames: an absurd index, an image larger than it claims."""

import struct
import time
import urllib.error
import urllib.request
import zlib
from contextlib import suppress
from pathlib import Path

import msgspec
import psutil

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.runs.live_run import SENT_ROOM, SMALL_ROOM, LiveRun
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_message
from hsslam_proto.request_messages import Status
from hsslam_services.bus.bus import Bus, free_endpoint
from hsslam_services.run.run_info import RunInfo

NO_SHARED_MEMORY = {"transport/shared_memory/enabled": False}
_STRANGE_INDEX = 2**62
_WATCH_S = 5.0
_SIDE_PX = 16384
_MOST_MB = 300.0  # growth of memory while an image is refused
_REPLY_S = 2.0


def small_room_frames(count: int) -> list[Frame]:
    """The first frames of the room, 160x120."""
    options = SourceOptions(synth=SynthOptions(width_px=160, height_px=120), frames=count)
    frames = open_source("synth:room", options).frames()
    return [frame for frame in frames if isinstance(frame, Frame)]


def absurd_index(experiment: Experiment) -> Finding:
    """Send ten frames with an index near 2^62 beside the camera's; expect poses for the camera's frames."""
    metrics = int(free_endpoint().rpartition(":")[2])
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000", "--metrics-port", str(metrics))
    run.wait_for_poses(30)
    (frame,) = small_room_frames(1)
    inside = RunInfo.read(run.out).endpoint  # the port takes no frames
    with Bus(inside, "robot", "stranger", settings=NO_SHARED_MEMORY) as bus:
        publisher = bus.publisher(topics.FRAME)
        bus.live_processes()  # a round trip: the router knows the publisher
        for k in range(10):  # the tracker takes only the newest frame
            message = frame_message(frame, time.time_ns())
            publisher.put(msgspec.structs.replace(message, index=_STRANGE_INDEX + k))
            time.sleep(0.03)
    before = _status(run)
    time.sleep(_WATCH_S)
    after = _status(run)
    health = _health(metrics)
    run.kill_worker("tracker")
    run.wait_until_ready()
    restarted = _status(run)
    time.sleep(_WATCH_S / 2)
    later = _status(run)
    sent = after.frames_sent - before.frames_sent
    answered = _answered(after) - _answered(before)
    answered_later = _answered(later) - _answered(restarted)
    sent_later = later.frames_sent - restarted.frames_sent
    return Finding(
        answered < 0.6 * sent or answered_later < 0.6 * sent_later or health != 200,
        f"{sent} frames sent and {answered} answered in {_WATCH_S:g} s; /healthz {health}; after a "
        f"restart of the tracker {sent_later} and {answered_later}",
    )


def image_larger_than_it_claims(experiment: Experiment) -> Finding:
    """Send a small PNG of 268 Mpx; expect that its header is refused, without decoding."""
    frames = small_room_frames(30)
    run = experiment.serve(*SENT_ROOM)
    run.wait_until_ready()
    with Bus(run.endpoint, "robot", "camera", settings=NO_SHARED_MEMORY) as bus:
        publisher = bus.publisher(topics.FRAME)
        poses = bus.subscribe(topics.POSE, 64, history=False)
        for frame in frames[:15]:
            publisher.put(frame_message(frame, time.time_ns()))
            poses.wait(30.0 if frame.index == 0 else _REPLY_S)
        watched = {name: _process(run, name) for name in ("tracker", "recorder")}
        before_mb = {name: _peak_mb(process) for name, process in watched.items()}
        message = frame_message(frames[15], time.time_ns())
        large = _png(_SIDE_PX)
        begin_s = time.monotonic()
        publisher.put(
            msgspec.structs.replace(message, color=memoryview(large), color_encoding="png")
        )
        for frame in frames[16:]:
            publisher.put(frame_message(frame, time.time_ns()))
            if poses.wait(_REPLY_S) is not None:
                break
        silent_s = time.monotonic() - begin_s
    grown_mb = {name: _peak_mb(process) - before_mb[name] for name, process in watched.items()}
    grown = ", ".join(f"{name} {mb:.0f} MB" for name, mb in grown_mb.items())
    return Finding(
        max(grown_mb.values()) > _MOST_MB or silent_s > _REPLY_S,
        f"a PNG of {len(large)} bytes and {_SIDE_PX}x{_SIDE_PX} px: peak memory grew by {grown}; the "
        f"next pose came after {silent_s:.1f} s",
    )


def _status(run: LiveRun) -> Status:
    if (status := run.status()) is None:
        raise CouldNotTellError(f"no answer to status: {run.last_words}")
    return status


def _answered(status: Status) -> int:
    return status.frames_tracked + status.frames_lost


def _health(port: int) -> int:
    """HTTP status of /healthz."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=5) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def _process(run: LiveRun, name: str) -> psutil.Process:
    run.wait_until(lambda: run.pid_of(name) is not None, 30)
    pid = run.pid_of(name)
    if pid is None:
        raise CouldNotTellError(f"{name} has just ended")
    return psutil.Process(pid)


def _peak_mb(process: psutil.Process) -> float:
    """Largest resident size so far, MB; 0 once it has ended."""
    with suppress(OSError), Path(f"/proc/{process.pid}/status").open() as lines:
        for line in lines:
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1e3
    return 0.0


def _png(side_px: int) -> bytes:
    """A PNG of one bit a pixel, all black."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        sums = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + sums

    packer, row = zlib.compressobj(9), bytes(side_px // 8 + 1)
    data = b"".join(packer.compress(row) for _ in range(side_px)) + packer.flush()
    head = struct.pack(">IIBBBBB", side_px, side_px, 1, 0, 0, 0, 0)
    parts = (chunk(b"IHDR", head), chunk(b"IDAT", data), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)
