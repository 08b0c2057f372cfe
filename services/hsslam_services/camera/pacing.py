"""Paces of the camera: send each frame when the last one is done (lockstep), or at once (live)."""

import time
from typing import Protocol

from hsslam_node.frame import Frame
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_message
from hsslam_proto.run_messages import Step
from hsslam_services.bus.bus import Publisher
from hsslam_services.bus.log_lag import LogLag
from hsslam_services.bus.peers import Peers
from hsslam_services.bus.robot_sensors import RobotSensors
from hsslam_services.camera.realtime import NEEDED, OTHERS
from hsslam_services.launch.worker import Worker

_RESEND_S = 30.0
_POLL_S = 0.05


class Pace(Protocol):
    """Decides when to send a frame; `send` returns when the next frame may be prepared.

    `wait_ns`: how late the frame comes because its source waited for a disk.
    `held`: the run was paused for this time before the next frame is sent; False if that frame is too old.
    `lag_ns`: how late a frame of a recording would come now, ns; thread-safe.
    `is_late`: whether a frame of a recording, which is about to be read, would be too late; thread-safe.
    """

    def wait_for_peers(self) -> None: ...

    def send(self, frame: Frame, wait_ns: int = 0) -> None: ...

    def held(self, seconds: float) -> bool: ...

    def is_late(self, index: int, source_ns: int) -> bool: ...

    def lag_ns(self, source_ns: int) -> int: ...

    def begin_map_epoch(self) -> None: ...


class Lockstep:
    """Sends frame k+1 when mapping and BA of frame k are done and the recorder keeps up.

    Sends a frame again after a restart of a process that may owe the answer, or after 30 s.
    """

    def __init__(self, worker: Worker, frames: Publisher, publisher: int) -> None:
        self._worker = worker
        self._frames = frames
        self._publisher = publisher
        self._steps = worker.bus.subscribe(topics.STEP, 64)
        self._peers = Peers(worker.bus)
        self._lag = LogLag(has_recorder=False)

    def wait_for_peers(self) -> None:
        """Wait until all processes that take part in a step take work."""
        self._peers.wait((*NEEDED, "global_ba"), OTHERS, self._worker)
        self._lag = LogLag(all(map(self._peers.has_heard, OTHERS)))

    def held(self, seconds: float) -> bool:
        """True: there is no clock."""
        return True

    def is_late(self, index: int, source_ns: int) -> bool:
        """Never: the run waits for each frame."""
        return False

    def lag_ns(self, source_ns: int) -> int:
        """None: there is no clock."""
        return 0

    def begin_map_epoch(self) -> None:
        """Nothing to do: the next frame waits for the new map anyway."""

    def send(self, frame: Frame, wait_ns: int = 0) -> None:
        """Publish a frame, and wait for its step `done`."""
        message = frame_message(frame, time.time_ns(), self._publisher)
        self._frames.put(message)
        self._lag.sent(self._publisher, frame.index)
        sent_s = time.monotonic()
        done = Step(stage="done", index=frame.index, publisher=self._publisher)
        is_done = False
        while not self._worker.should_stop():
            step = self._steps.wait(_POLL_S)
            if step is not None:
                self._lag.hear(step)
                is_done |= step == done
            if is_done and not self._lag.must_wait():
                return
            has_restarted = self._peers.restarted()
            if has_restarted:
                self._lag.forget()
            if not is_done and (has_restarted or time.monotonic() - sent_s > _RESEND_S):
                self._worker.count("resent")
                self._frames.put(message)
                sent_s = time.monotonic()


class Live:
    """Sends the frames of a live camera at once, stamped with the time of arrival.

    `is_restarted`: frames were sent before; then it waits only for what tracking needs.
    """

    def __init__(
        self,
        worker: Worker,
        frames: Publisher,
        publisher: int,
        sensors: RobotSensors,
        *,
        is_restarted: bool = False,
    ) -> None:
        self._others = () if is_restarted else OTHERS
        self._sensors = sensors
        self._worker = worker
        self._frames = frames
        self._publisher = publisher
        self._peers = Peers(worker.bus)

    def wait_for_peers(self) -> None:
        """Wait until tracker and mapper take work, and before the first frame the recorder."""
        self._peers.wait(NEEDED, self._others, self._worker)

    def held(self, seconds: float) -> bool:
        """Whether there was no pause: frames during one are lost, and the camera moves on meanwhile."""
        return seconds == 0

    def is_late(self, index: int, source_ns: int) -> bool:
        """Never: a live camera delivers its newest frame."""
        return False

    def lag_ns(self, source_ns: int) -> int:
        """None: a live camera delivers its newest frame."""
        return 0

    def begin_map_epoch(self) -> None:
        """Nothing to do: a live camera waits for no map."""

    def send(self, frame: Frame, wait_ns: int = 0) -> None:
        """Publish a frame; the tracker takes the newest."""
        stamp_ns = time.time_ns()
        frame = self._sensors.given(frame, stamp_ns)
        self._frames.put(frame_message(frame, stamp_ns, self._publisher))
