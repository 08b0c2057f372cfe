"""When the camera sends a frame: on the sensor's clock, or when the last one is done with."""

import time
from typing import Protocol

from hsslam_node.frame import Frame
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_message
from hsslam_services.bus.bus import Publisher
from hsslam_services.bus.peers import Peers
from hsslam_services.launch.worker import Worker
from hsslam_services.run.camera_progress import CameraProgress

_RESEND_S = 30.0
_POLL_S = 0.05
_LARGEST_LAG_S = 1.0
_NEEDED = ("tracker", "mapper")
_OTHERS = ("recorder",)  # logs from the first frame on, if it can


class Pace(Protocol):
    """Decides when a frame goes out; `send` returns when the next one may be prepared."""

    def wait_for_peers(self) -> None: ...

    def send(self, frame: Frame) -> None: ...

    def held(self, seconds: float) -> None: ...

    def begin_world(self) -> None: ...


class Lockstep:
    """Sends frame k+1 when mapping and BA of frame k are done.

    A frame is sent again when a process that may owe the answer was restarted, or after 30 s.
    """

    def __init__(self, worker: Worker, frames: Publisher) -> None:
        self._worker = worker
        self._frames = frames
        self._steps = worker.bus.subscribe(topics.STEP, 64)
        self._peers = Peers(worker.bus)

    def wait_for_peers(self) -> None:
        """Wait until all processes that a step needs take work."""
        self._peers.wait((*_NEEDED, "global_ba"), _OTHERS, self._worker)

    def held(self, seconds: float) -> None:
        """Nothing to do: a step takes as long as it takes."""

    def begin_world(self) -> None:
        """Nothing to do: the next frame waits for its map anyway."""

    def send(self, frame: Frame) -> None:
        """Publish, and wait for the step `done` of this frame."""
        message = frame_message(frame, stamp_ns=time.time_ns())
        self._frames.put(message)
        sent_s = time.monotonic()
        while not self._worker.should_stop():
            step = self._steps.wait(_POLL_S)
            if step is not None and step.stage == "done" and step.index == frame.index:
                return
            if self._peers.restarted() or time.monotonic() - sent_s > _RESEND_S:
                self._worker.count("resent")
                self._frames.put(message)
                sent_s = time.monotonic()


class Realtime:
    """Sends frames when the sensor would have; the clock starts when the first map is there.

    `clock_scale` stretches the source's stamps to another rate.
    """

    def __init__(
        self, worker: Worker, frames: Publisher, progress: CameraProgress, clock_scale: float
    ) -> None:
        self._worker = worker
        self._frames = frames
        self._progress = progress
        self._scale = clock_scale
        self._maps = worker.bus.subscribe(topics.MAP, 1)
        self._poses = worker.bus.subscribe(topics.POSE, 8)
        self._peers = Peers(worker.bus)

    def wait_for_peers(self) -> None:
        """Wait until tracker, mapper and recorder take work, unless frames were sent before."""
        if not self._progress.pinned_wall_ns:
            self._peers.wait(_NEEDED, _OTHERS, self._worker)

    def send(self, frame: Frame) -> None:
        """Publish at the frame's time. Until there is a map, one frame at a time, answered."""
        if not self._progress.pinned_wall_ns:
            self._send_until_answered(frame)
            return
        stamp_ns = self._stamp(frame)
        self._sleep_until(stamp_ns)
        self._frames.put(frame_message(frame, stamp_ns))

    def held(self, seconds: float) -> None:
        """The sensor's clock stood still for so long."""
        if self._progress.pinned_wall_ns:
            self._progress.pinned_wall_ns += round(1e9 * seconds)

    def begin_world(self) -> None:
        """The map was thrown away: the clock stands still until there is another."""
        self._progress.pinned_wall_ns = 0
        self._maps.drain()
        self._peers.restarted()  # known: they take work

    def _send_until_answered(self, frame: Frame) -> None:
        stamp_ns = time.time_ns()
        message = frame_message(frame, stamp_ns)
        self._frames.put(message)
        while not self._worker.should_stop():
            has_map = self._maps.wait(_POLL_S) is not None
            status = {p.status for p in self._poses.drain() if p.index == frame.index}
            if has_map or "tracked" in status:  # in a saved map nobody need step it first
                self._progress.pinned_source_ns = round(frame.stamp_ns * self._scale)
                self._progress.pinned_wall_ns = time.time_ns()
                return
            if "lost" in status:
                return  # nothing to start a map on, or another place: the next frame may do
            if self._peers.restarted():
                self._worker.count("resent")
                self._frames.put(message)

    def _stamp(self, frame: Frame) -> int:
        """Wall time of the frame, ns. A source slower than its sensor moves the clock."""
        source_ns = round(frame.stamp_ns * self._scale)
        lag_ns = time.time_ns() - self._progress.wall_ns(source_ns)
        if lag_ns > _LARGEST_LAG_S * 1e9:
            self._progress.pinned_wall_ns += lag_ns
            self._worker.count("clock_shifts")
            if self._worker.counters["clock_shifts"] == 1:
                self._worker.event("warning", "the source is slower than its clock: clock moved")
        return self._progress.wall_ns(source_ns)

    def _sleep_until(self, wall_ns: int) -> None:
        wait_s = (wall_ns - time.time_ns()) / 1e9
        if wait_s > 0:
            self._worker.stop_event().wait(wait_s)


class Live:
    """Sends the frames of a live camera at once, with the time at which they came."""

    def __init__(self, worker: Worker, frames: Publisher) -> None:
        self._worker = worker
        self._frames = frames
        self._peers = Peers(worker.bus)

    def wait_for_peers(self) -> None:
        """Wait until tracker, mapper and recorder take work."""
        self._peers.wait(_NEEDED, _OTHERS, self._worker)

    def held(self, seconds: float) -> None:
        """Nothing to do: what came meanwhile is gone."""

    def begin_world(self) -> None:
        """Nothing to do: a live camera waits for no map."""

    def send(self, frame: Frame) -> None:
        """Publish; the tracker takes the newest."""
        self._frames.put(frame_message(frame, stamp_ns=time.time_ns()))
