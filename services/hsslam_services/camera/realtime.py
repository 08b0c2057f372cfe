"""Sends the frames of a recording on the sensor's clock, unaffected by changes of the wall clock."""

import time
from collections.abc import Callable, Mapping

from hsslam_node.frame import Frame
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_message
from hsslam_services.bus.bus import Publisher
from hsslam_services.bus.peers import Peers
from hsslam_services.bus.robot_sensors import RobotSensors
from hsslam_services.camera.wall_clock import WallClock
from hsslam_services.launch.worker import Worker
from hsslam_services.run.camera_progress import CameraProgress

_POLL_S = 0.05
_LARGEST_LAG_NS = 10**9
_LONGEST_WAIT_NS = 10**9  # for the next frame of a recording with a gap
_LATE = 0.5  # periods after its time
_TURN_S = 1.0  # of a long wait, between turns of the loop
_REPEATED_NS = 1_000_000  # after the stamp before: no camera is as fast, so it is the same stamp
_LOGGED_WITHIN_S = 5.0  # that the clock waits for the log once the first frame is tracked
NEEDED = ("tracker", "mapper")
OTHERS = ("recorder",)  # logs from the first frame if it starts in time


class Realtime:
    """Sends each frame when the sensor would have; the sensor's clock starts when the first map exists.

    `clock_scale` stretches the source's stamps to another rate, `period_s` apart. At a gap in the stamps it
    waits at most 1 s (or three periods of a slow sensor). Frames with the same stamp, as of a clock of whole
    seconds, come `period_s` apart. It reports gaps, steps back and repeated stamps. A source that is
    slower than its sensor leaves out frames, so that the others come in time; if the source cannot leave
    them out, its clock is set back once it is 1 s behind. `map_epoch()` gives the number of resets of the
    map; after a reset, no answer to a frame that was sent before it is awaited.
    """

    def __init__(
        self,
        worker: Worker,
        frames: Publisher,
        progress: CameraProgress,
        clock_scale: float,
        sensors: RobotSensors,
        map_epoch: Callable[[], int],
        period_s: float = 1 / 30,
    ) -> None:
        self._worker = worker
        self._frames = frames
        self._progress = progress
        self._scale = clock_scale
        self._sensors = sensors
        self._longest_wait_ns = max(_LONGEST_WAIT_NS, round(3e9 * period_s))
        self._late_ns = round(_LATE * 1e9 * period_s)
        self._period_ns, self._last_due_ns = round(1e9 * period_s), 0
        self._read_ns = -1  # stamp of the last frame that was read
        # of the newest frame that was read after a step back in the stamps, and of the last one sent
        self._step_index = self._sent_index = -1
        self._wall = WallClock()
        self._maps = worker.bus.subscribe(topics.MAP, 1)
        self._poses = worker.bus.subscribe(topics.POSE, 8)
        self._peers = Peers(worker.bus)
        self._map_epoch, self._epoch = map_epoch, map_epoch()

    def wait_for_peers(self) -> None:
        """Wait until tracker, mapper and recorder take work, unless the clock runs already."""
        if not self._progress.pinned_ns:
            self._peers.wait(NEEDED, OTHERS, self._worker)

    def send(self, frame: Frame, wait_ns: int = 0) -> None:
        """Publish at the frame's time. Before the first map, publish one frame at a time, wait for its pose,
        and send it again if tracker or recorder do not get it: the world of a log is its first frame."""
        if not self._progress.pinned_ns:
            self._send_until_answered(frame)
            self._sent_index = frame.index
            return
        due_ns = self._due_ns(frame)
        self._sent_index = frame.index
        self._sleep_until(due_ns)
        stamp_ns = self._stamp_ns(due_ns)
        frame = self._sensors.given(frame, stamp_ns)
        wait_ns = min(wait_ns, max(time.monotonic_ns() - due_ns, 0))
        self._frames.put(frame_message(frame, stamp_ns, self._progress.publisher, wait_ns))

    def is_late(self, index: int, source_ns: int) -> bool:
        """Whether the frame of this stamp, which is about to be read, is late by more than half a period.

        After a step back in the stamps, no frame is late until `send` has set the clock by that frame. A
        frame with the stamp of the one before is never late.
        """
        if source_ns < self._read_ns:
            self._step_index = index
        is_repeated = _is_repeated(source_ns, self._read_ns)
        self._read_ns = source_ns
        if not self._progress.pinned_ns or self._step_index > self._sent_index or is_repeated:
            return False
        return self._late_ns < self.lag_ns(source_ns) < _LARGEST_LAG_NS

    def lag_ns(self, source_ns: int) -> int:
        """How late a frame of this stamp would come now; 0 while the clock stands still."""
        if not self._progress.pinned_ns:
            return 0
        return time.monotonic_ns() - self._progress.due_ns(source_ns, self._scale)

    def held(self, seconds: float) -> bool:
        """Shift the sensor's clock: it stood still for `seconds`. True: so the next frame is not too old."""
        if self._progress.pinned_ns:
            self._progress.pinned_ns += round(1e9 * seconds)
            if self._last_due_ns:
                self._last_due_ns += round(1e9 * seconds)
        return True

    def begin_map_epoch(self) -> None:
        """After a reset of the map, the clock stands still until there is a new map."""
        self._progress.pinned_ns = self._last_due_ns = 0
        self._epoch = self._map_epoch()
        self._maps.drain()
        self._peers.restarted()  # forget earlier restarts

    def _send_until_answered(self, frame: Frame) -> None:
        publisher = self._progress.publisher
        stamp_ns = time.time_ns()
        message = frame_message(self._sensors.given(frame, stamp_ns), stamp_ns, publisher)
        self._peers.restarted()  # takes in the newest heartbeats
        before = {name: self._peers.frames_received(name) for name in ("tracker", *OTHERS)}
        self._frames.put(message)
        sent_s = time.monotonic()
        answered_s: float | None = None
        while not self._worker.should_stop():
            if self._map_epoch() != self._epoch:
                return  # the tracker knows this frame: the next one begins the new map
            has_map = self._maps.wait(_POLL_S) is not None
            name = publisher, frame.index
            status = {p.status for p in self._poses.drain() if (p.publisher, p.index) == name}
            if "lost" in status:
                return  # no map can start here, or another place: try the next frame
            if answered_s is None and (has_map or "tracked" in status):
                answered_s = time.monotonic()  # a saved map needs no first step
            has_restarted = self._peers.restarted()
            if answered_s is not None and not self._is_waited_for(before, answered_s):
                self._progress.pinned_source_ns = frame.stamp_ns
                self._progress.pinned_ns = time.monotonic_ns()
                return
            awaited = ("tracker",) if answered_s is None else OTHERS
            has_missed = any(self._peers.has_missed(p, before[p], sent_s) for p in awaited)
            if has_restarted or has_missed:
                self._worker.count("resent")
                self._frames.put(message)
                sent_s = time.monotonic()

    def _is_waited_for(self, before: Mapping[str, int | None], answered_s: float) -> bool:
        """Whether a process that logs from the first frame lacks it; for 5 s at most after the answer."""
        if time.monotonic() - answered_s > _LOGGED_WITHIN_S:
            return False
        for name in OTHERS:
            old, new = before[name], self._peers.frames_received(name)
            if old is not None and new == old and not self._peers.is_silent(name):
                return True
        return False

    def _due_ns(self, frame: Frame) -> int:
        """Monotonic time of the frame, ns; moves the clock at a gap, at a step back, for a slow source."""
        if self._last_due_ns and _is_repeated(frame.stamp_ns, self._progress.last_source_ns):
            return self._next_due_ns(frame)
        wait_ns = self._progress.due_ns(frame.stamp_ns, self._scale) - time.monotonic_ns()
        is_back = frame.stamp_ns < self._progress.last_source_ns
        if is_back:
            self._worker.count("steps back")
            back_s = (self._progress.last_source_ns - frame.stamp_ns) / 1e9
            self._report(frame, f"its stamp is {back_s:g} s before the previous one")
        if wait_ns > self._longest_wait_ns:
            self._progress.pinned_ns -= wait_ns - self._longest_wait_ns
            self._worker.count("gaps")
            waited_s = self._longest_wait_ns / 1e9
            self._report(
                frame,
                f"the stamps have a gap of {wait_ns / 1e9:.1f} s: the camera process waits {waited_s:g} s",
            )
        elif wait_ns < (0 if is_back else -_LARGEST_LAG_NS):
            self._progress.pinned_ns -= wait_ns
            if not is_back:
                self._worker.count("clock_shifts")
                if self._worker.counters["clock_shifts"] == 1:
                    self._report(
                        frame,
                        "the source delivers frames too slowly: the clock of its sensor is set back",
                    )
        self._last_due_ns = self._progress.due_ns(frame.stamp_ns, self._scale)
        return self._last_due_ns

    def _next_due_ns(self, frame: Frame) -> int:
        """Monotonic time of a frame with the stamp of the one before, ns: one period later."""
        self._worker.count("repeated stamps")
        if self._worker.counters["repeated stamps"] == 1:
            apart = f"such frames are sent {1e-6 * self._period_ns:.0f} ms apart"
            self._report(frame, f"its stamp is that of the frame before: {apart}")
        self._last_due_ns += self._period_ns
        return self._last_due_ns

    def _stamp_ns(self, due_ns: int) -> int:
        """The wall clock at a monotonic time, ns."""
        stepped_s = self._wall.follow()
        if stepped_s:
            self._worker.count("wall clock steps")
            self._worker.event("warning", f"the wall clock was set by {stepped_s:+.1f} s")
        return self._wall.at(due_ns)

    def _sleep_until(self, due_ns: int) -> None:
        while (wait_s := (due_ns - time.monotonic_ns()) / 1e9) > 0:
            self._worker.stop_event().wait(min(wait_s, _TURN_S))
            if self._worker.should_stop():
                return

    def _report(self, frame: Frame, text: str) -> None:
        self._worker.event("warning", f"frame {frame.index}: {text}")


def _is_repeated(source_ns: int, last_ns: int) -> bool:
    """Whether a stamp is that of the frame before, whose stamp is `last_ns`; -1: there is none."""
    return last_ns >= 0 and 0 <= source_ns - last_ns < _REPEATED_NS
