"""How long frames have come without a pose; a file of its own, as it follows two streams of messages."""

from hsslam_proto.run_messages import Health, TopicCounts
from hsslam_proto.topics import FRAME

_FLOWS_S = 3.0  # frames come as long as the tracker tells of new ones so often


class Silence:
    """Counts from the first frame that was not answered; heartbeats of the tracker tell of frames, in
    whatever state its loop is. Times are of the monotonic clock, s."""

    def __init__(self) -> None:
        self._received: tuple[int, int] | None = None  # tracker's pid, frames that it has got
        self._frame_s = float("-inf")
        self._since_s: float | None = None

    def heard(self, health: Health, now_s: float) -> None:
        """A heartbeat came; only those of the tracker count."""
        if health.process != "tracker":
            return
        received = health.topics.get(FRAME.name, TopicCounts()).received
        before = self._received
        self._received = health.pid, received
        if received > (before[1] if before and before[0] == health.pid else 0):
            self._frame_s = now_s
            if self._since_s is None:
                self._since_s = now_s

    def posed(self) -> None:
        """A pose came."""
        self._since_s = None

    def seconds(self, now_s: float) -> float:
        """0 while poses come, and while no frames do."""
        if self._since_s is None or now_s - self._frame_s > _FLOWS_S:
            return 0.0
        return now_s - self._since_s
