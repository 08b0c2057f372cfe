"""Requests to pause and to go on; the camera follows `sys/hold`."""

from hsslam_node.proto import topics
from hsslam_node.proto.messages import Hold
from hsslam_node.proto.request_messages import Done
from hsslam_node.services.bus import Bus
from hsslam_node.services.request_queue import Asked
from hsslam_node.services.run_info import RunInfo


class Holding:
    """Holds the camera for clients, and for the service itself while it cannot take frames.

    `is_paused`: a client has asked for it.
    """

    def __init__(self, bus: Bus, run: RunInfo) -> None:
        self.is_paused = False
        self._run = run
        self._holds = bus.publisher(topics.HOLD)

    def set(self, asked: Asked, paused: bool) -> None:
        """Do as asked and tell it; refused where the camera is not ours."""
        if not self._run.options.has_camera_process:
            name = asked.request.name
            asked.refuse("not_now", f"{name}: frames come from outside: hold that camera itself")
            return
        word = "paused" if paused else "running"
        again = self.is_paused == paused
        self.is_paused = paused
        self._holds.put(Hold(paused=paused))
        asked.answer(Done(text=f"was {word} already" if again else word))

    def suspend(self) -> None:
        """Let no frame come until `release`."""
        self._holds.put(Hold(paused=True))

    def release(self) -> None:
        """Go on, unless a client has asked for a pause."""
        self._holds.put(Hold(paused=self.is_paused))
