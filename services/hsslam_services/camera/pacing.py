"""When the camera sends a frame: on the sensor's clock, or when the last one is done with."""

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
    """Decides when a frame goes out; `send` returns when the next one may be prepared.

    `is_late`: whether a frame of a recording, which is about to be read, comes too late; another thread may
    ask it.
    """

    def wait_for_peers(self) -> None: ...

    def send(self, frame: Frame) -> None: ...

    def held(self, seconds: float) -> None: ...

    def is_late(self, index: int, source_ns: int) -> bool: ...

    def begin_map_epoch(self) -> None: ...


class Lockstep:
    """Sends frame k+1 when mapping and BA of frame k are done, and the recorder keeps up.

    A frame is sent again when a process that may owe the answer was restarted, or after 30 s.
    """

    def __init__(self, worker: Worker, frames: Publisher, publisher: int) -> None:
        self._worker = worker
        self._frames = frames
        self._publisher = publisher
        self._steps = worker.bus.subscribe(topics.STEP, 64)
        self._peers = Peers(worker.bus)
        self._lag = LogLag(has_recorder=False)

    def wait_for_peers(self) -> None:
        """Wait until all processes that a step needs take work."""
        self._peers.wait((*NEEDED, "global_ba"), OTHERS, self._worker)
        self._lag = LogLag(all(map(self._peers.has_heard, OTHERS)))

    def held(self, seconds: float) -> None:
        """Nothing to do: a step takes as long as it takes."""

    def is_late(self, index: int, source_ns: int) -> bool:
        """Never: every frame is waited for."""
        return False

    def begin_map_epoch(self) -> None:
        """Nothing to do: the next frame waits for its map anyway."""

    def send(self, frame: Frame) -> None:
        """Publish, and wait for the step `done` of this frame."""
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
    """Sends the frames of a live camera at once, with the time at which they came."""

    def __init__(
        self, worker: Worker, frames: Publisher, publisher: int, sensors: RobotSensors
    ) -> None:
        self._sensors = sensors
        self._worker = worker
        self._frames = frames
        self._publisher = publisher
        self._peers = Peers(worker.bus)

    def wait_for_peers(self) -> None:
        """Wait until tracker, mapper and recorder take work."""
        self._peers.wait(NEEDED, OTHERS, self._worker)

    def held(self, seconds: float) -> None:
        """Nothing to do: what came meanwhile is gone."""

    def is_late(self, index: int, source_ns: int) -> bool:
        """Never: a live camera is asked for its newest frame."""
        return False

    def begin_map_epoch(self) -> None:
        """Nothing to do: a live camera waits for no map."""

    def send(self, frame: Frame) -> None:
        """Publish; the tracker takes the newest."""
        stamp_ns = time.time_ns()
        frame = self._sensors.given(frame, stamp_ns)
        self._frames.put(frame_message(frame, stamp_ns, self._publisher))
