"""Requests to go on mapping, or only to localise."""

import time

from hsslam_node.proto import topics
from hsslam_node.proto.messages import Event
from hsslam_node.proto.request_messages import Done, Mode, SetMode
from hsslam_node.services.bus import Bus
from hsslam_node.services.request_queue import Asked
from hsslam_node.services.run_info import RunInfo
from hsslam_node.services.run_mode import RunMode


class ModeSetting:
    """Writes the mode of the run, which every process looks at before it changes anything.

    `has_map`: whether there is one to localise in.
    """

    def __init__(self, bus: Bus, run: RunInfo) -> None:
        self.has_map = bool(run.options.map)
        self._mode = RunMode(run.arena_dir)
        self._events = bus.publisher(topics.EVENT)

    @property
    def now(self) -> Mode:
        """The mode that the run is in."""
        return "localise-only" if self._mode.localise_only else "mapping"

    def set(self, asked: Asked) -> None:
        """Do as asked and tell it; refused while there is no map yet."""
        wanted: SetMode = asked.message
        if wanted.mode == self.now:
            asked.answer(Done(text=f"was {wanted.mode} already"))
        elif wanted.mode == "localise-only" and not self.has_map:
            asked.refuse("not_now", "set-mode: there is no map yet: expected a first keyframe")
        else:
            self._mode.localise_only = wanted.mode == "localise-only"
            text, now = f"mode: {wanted.mode}, as asked", time.time_ns()
            self._events.put(Event(process="supervisor", level="info", text=text, stamp_ns=now))
            asked.answer(Done(text=wanted.mode))
