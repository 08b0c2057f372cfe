"""Counts of a run heard on the bus, and a histogram of latencies as Prometheus has it."""

import statistics
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, field

from hsslam_proto import topics
from hsslam_proto.messages import Event, Health, MapVersion, Pose, SourceEnd
from hsslam_services.bus.bus import Bus

BOUNDS_MS = (5, 10, 15, 20, 25, 33, 50, 75, 100, 150, 200, 300, 500, 1000)
_RECENT = 64  # poses for rate and latency


class LatencyBins:
    """Counts of latencies up to each bound, and their sum."""

    def __init__(self) -> None:
        self.sum_ms = 0.0
        self._counts = [0] * (len(BOUNDS_MS) + 1)  # the last: above all bounds

    def add(self, latency_ms: float) -> None:
        """Count one."""
        self._counts[bisect_left(BOUNDS_MS, latency_ms)] += 1
        self.sum_ms += latency_ms

    def cumulative(self) -> list[int]:
        """How many were at most so long, for each bound, and how many there were."""
        total = 0
        return [total := total + count for count in self._counts]


@dataclass
class RunState:
    """Counts and newest messages; `Listener` fills it."""

    pose: Pose | None = None
    map: MapVersion | None = None
    source_end: SourceEnd | None = None
    last_keyframe: int = -1
    tracked: int = 0
    lost: int = 0
    ba_rounds: int = 0
    pose_times_s: deque[float] = field(default_factory=lambda: deque(maxlen=_RECENT))
    latencies_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_RECENT))
    latency_bins: LatencyBins = field(default_factory=LatencyBins)

    @property
    def fps(self) -> float:
        """Poses per second, of the last few seconds."""
        times = self.pose_times_s
        span_s = times[-1] - times[0] if times else 0.0
        return (len(times) - 1) / span_s if span_s > 0 else 0.0

    @property
    def latency_ms(self) -> float:
        """Median of the last latencies from sensor stamp to published pose."""
        return statistics.median(self.latencies_ms) if self.latencies_ms else 0.0

    def has_answered(self, end: SourceEnd, dropped: int) -> bool:
        """Whether there is a pose of the last frame; else, whether each frame is answered or dropped."""
        if self.pose is not None and 0 <= end.last_index <= self.pose.index:
            return True
        return self.tracked + self.lost + dropped >= end.frame_count

    def forget_map(self) -> None:
        """The map was thrown away; counts go on."""
        self.pose = self.map = None
        self.last_keyframe = -1

    def posed(self, pose: Pose) -> None:
        self.pose = pose
        self.tracked += pose.status != "lost"
        self.lost += pose.status == "lost"
        self.pose_times_s.append(pose.publish_ns / 1e9)
        latency_ms = (pose.publish_ns - pose.stamp_ns) / 1e6
        self.latencies_ms.append(latency_ms)
        self.latency_bins.add(latency_ms)


class Listener:
    """The supervisor's ears: subscriptions to everything small."""

    def __init__(self, bus: Bus) -> None:
        self.state = RunState()
        self._poses = bus.subscribe(topics.POSE, 256)
        self._maps = bus.subscribe(topics.MAP, 64)
        self._keyframes = bus.subscribe(topics.KEYFRAME, 4096)
        self._corrections = bus.subscribe(topics.CORRECTION, 16)
        self._end = bus.subscribe(topics.SOURCE_END, 1)
        self._health = bus.subscribe(topics.HEALTH, 256)
        self._events = bus.subscribe(topics.EVENT, 256)

    def listen(self) -> tuple[list[Health], list[Event]]:
        """Take in what has come; returns the heartbeats and events of this time."""
        state = self.state
        for pose in self._poses.drain():
            state.posed(pose)
        for version in self._maps.drain():
            state.map = version
        for keyframe in self._keyframes.drain():
            state.last_keyframe = max(state.last_keyframe, keyframe.id)
        state.ba_rounds += len(self._corrections.drain())
        state.source_end = self._end.poll() or state.source_end
        return self._health.drain(), self._events.drain()
