"""Which processes of the run take work, from their heartbeats."""

import time
from collections.abc import Iterable
from typing import Protocol

from hsslam_proto import topics
from hsslam_proto.run_messages import Health
from hsslam_services.bus.bus import Bus

_POLL_S = 0.1
_ON_ITS_WAY_S = 2.0  # longest transfer of a frame; heartbeats come every 0.5 s
_SILENT_S = 1.5  # heartbeats come every 0.5 s
_LONGEST_WAIT_S = 30.0  # for processes that the run does not need


class CanStop(Protocol):
    """A worker that waits until it must stop."""

    def should_stop(self) -> bool: ...


class Peers:
    """Listens to the heartbeats of the other processes."""

    def __init__(self, bus: Bus) -> None:
        self._health = bus.subscribe(topics.HEALTH, 64)
        self._pids: dict[str, int] = {}
        self._frames: dict[str, tuple[int, float]] = {}  # received frames, and when it was reported

    def wait(self, names: Iterable[str], others: Iterable[str], waiting: CanStop) -> None:
        """Wait until all of `names` run, and for `others` at most 30 s, or until `waiting` must stop."""
        needed = set(names)
        missing = needed | set(others)
        give_up_s = time.monotonic() + _LONGEST_WAIT_S
        while missing and not waiting.should_stop():
            if not missing & needed and time.monotonic() > give_up_s:
                return
            health = self._health.wait(_POLL_S)
            if health is not None and health.state == "running":
                self._take(health)
                missing.discard(health.process)

    def has_heard(self, name: str) -> bool:
        """Whether a heartbeat of this process reported that it takes work."""
        return name in self._pids

    def restarted(self) -> bool:
        """Whether a process was restarted and runs again since the last call."""
        found = False
        for health in self._health.drain():
            if health.state == "running":
                found |= self._pids.get(health.process, health.pid) != health.pid
                self._take(health)
        return found

    def frames_received(self, name: str) -> int | None:
        """Number of frames received by this process, by its newest heartbeat; None if it takes none."""
        return self._frames[name][0] if name in self._frames else None

    def is_silent(self, name: str) -> bool:
        """Whether no heartbeat of this process came for 1.5 s."""
        heard_s = self._frames.get(name, (0, 0.0))[1]
        return time.monotonic() - heard_s > _SILENT_S

    def has_missed(self, name: str, before: int | None, sent_s: float) -> bool:
        """Whether this process counts only `before` frames more than 2 s after `sent_s` (monotonic)."""
        count, heard_s = self._frames.get(name, (0, 0.0))
        return count <= (before or 0) and heard_s - sent_s > _ON_ITS_WAY_S

    def _take(self, health: Health) -> None:
        self._pids[health.process] = health.pid
        if counts := health.topics.get(topics.FRAME.name):
            self._frames[health.process] = counts.received, time.monotonic()


class AtWork:
    """The other processes that still send; the last heartbeat of a process follows all its messages."""

    def __init__(self, own: str) -> None:
        self._own = own
        self._beating: set[str] = set()

    def __bool__(self) -> bool:
        return bool(self._beating)

    def hear(self, health: Health) -> None:
        """Take in a heartbeat."""
        if health.process == self._own:
            return
        if health.state == "stopping":
            self._beating.discard(health.process)
        else:
            self._beating.add(health.process)
