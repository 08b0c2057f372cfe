"""How long frames have come without a pose; apart, as it follows two streams of messages."""

from hsslam_proto.run_messages import Health, TopicCounts
from hsslam_proto.topics import FRAME

_FLOWS_S = 3.0  # frames count as coming for this time after the tracker reports new ones


class Silence:
    """Time since the first frame without an answer. The tracker's heartbeats report frames even if its loop
    hangs, those of the camera process frames that it cannot use and does not send. Times are of the monotonic
    clock, s."""

    def __init__(self) -> None:
        self._received: tuple[int, int] | None = None  # the tracker's pid and received frames
        # frames that the camera process could not use; if restarted, it counts on
        self._unusable: int | None = None
        self._frame_s = float("-inf")
        self._since_s: float | None = None

    def heard(self, health: Health, now_s: float) -> None:
        """Take in a heartbeat; only those of tracker and camera process count."""
        if health.process == "tracker":
            received = health.topics.get(FRAME.name, TopicCounts()).received
            before = self._received
            self._received = health.pid, received
            have_come = received > (before[1] if before and before[0] == health.pid else 0)
        elif health.process == "camera":
            unusable = health.counters.get("bad", 0)
            have_come = self._unusable is not None and unusable > self._unusable
            self._unusable = unusable
        else:
            return
        if have_come:
            has_paused = now_s - self._frame_s > _FLOWS_S
            self._frame_s = now_s
            if self._since_s is None or has_paused:
                self._since_s = now_s

    def posed(self) -> None:
        """Take in a pose."""
        self._since_s = None

    def seconds(self, now_s: float) -> float:
        """The silence so far; 0 while poses come, and while no frames come."""
        if self._since_s is None or now_s - self._frame_s > _FLOWS_S:
            return 0.0
        return now_s - self._since_s
