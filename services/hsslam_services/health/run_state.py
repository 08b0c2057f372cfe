"""The state of a run, collected from the bus: counts, newest messages, a histogram of latencies."""

import statistics
import time
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from hsslam_proto import topics
from hsslam_proto.messages import MapVersion, Pose
from hsslam_proto.run_messages import Event, Health, SourceEnd
from hsslam_services.bus.bus import Bus
from hsslam_services.governor.known_latencies import KnownLatencies
from hsslam_services.health.silence import Silence

BOUNDS_MS = (5, 10, 15, 20, 25, 33, 50, 75, 100, 150, 200, 300, 500, 1000)
_RECENT = 64  # poses for rate and latency
_RECENT_S = 5.0  # older ones do not count
_MOST_PUBLISHERS = 64  # of frames, whose newest pose is known
_STILL_S = 1.0  # without a pose, until the rate falls


class LatencyBins:
    """A histogram of latencies with the bounds `BOUNDS_MS`, and their sum."""

    def __init__(self) -> None:
        self.sum_ms = 0.0
        self._counts = [0] * (len(BOUNDS_MS) + 1)  # the last: above all bounds

    def add(self, latency_ms: float) -> None:
        """Count one latency."""
        self._counts[bisect_left(BOUNDS_MS, latency_ms)] += 1
        self.sum_ms += latency_ms

    def cumulative(self) -> list[int]:
        """Number of latencies up to each bound, and of all."""
        total = 0
        return [total := total + count for count in self._counts]


@dataclass
class RunState:
    """Counts and newest messages; `Listener` fills it."""

    pose: Pose | None = None
    map: MapVersion | None = None
    source_end: SourceEnd | None = None
    last_keyframe: int = -1  # also of a saved map that the run goes on with
    tracked: int = 0
    lost: int = 0
    in_fragments: int = 0  # of those lost
    ba_rounds: int = 0
    pose_version: tuple[int, int] = (0, 0)  # map epoch and version of the last correction
    started_s: float = field(default_factory=time.monotonic)
    recent: deque["PoseTimes"] = field(default_factory=lambda: deque(maxlen=_RECENT))
    newest_index: dict[int, int] = field(
        default_factory=dict
    )  # of poses, by publisher of the frames
    silence: Silence = field(default_factory=Silence)
    latency_bins: LatencyBins = field(default_factory=LatencyBins)
    _latencies: KnownLatencies = field(default_factory=KnownLatencies)

    def fps(self, now_s: float) -> float:
        """Poses per second over the last seconds; falls to 0 if no poses come."""
        times = [pose.heard_s for pose in self._since(now_s)]
        if len(times) < 2:
            return 0.0
        span_s = (now_s if now_s - times[-1] > _STILL_S else times[-1]) - times[0]
        return (len(times) - 1) / span_s if span_s > 0 else 0.0

    def latency_ms(self, now_s: float) -> float:
        """Median latency of the newest poses, from the sensor's stamp; 0 if no pose came for 5 s."""
        latencies = [ms for pose in self._since(now_s) if (ms := pose.latency_ms) is not None]
        return statistics.median(latencies) if latencies else 0.0

    def tracking(self, now_s: float) -> Literal["none", "initial", "tracked", "lost"]:
        """Status of the last pose; "none" before the first, and if no further one came for 5 s, or for twice
        the time between the last two if that is longer."""
        age_s = self.pose_age_s(now_s)
        if self.pose is None or age_s is None or self.silence.seconds(now_s) > _RECENT_S:
            return "none"
        times = [pose.heard_s for pose in self.recent][-2:]
        is_old = age_s > max(_RECENT_S, 2 * (times[-1] - times[0]))
        return "none" if is_old else self.pose.status

    def pose_age_s(self, now_s: float) -> float | None:
        """Time since the last pose, s; None before the first."""
        return now_s - self.recent[-1].heard_s if self.recent else None

    def _since(self, now_s: float) -> "list[PoseTimes]":
        return [pose for pose in self.recent if now_s - pose.heard_s <= _RECENT_S]

    def has_answered(self, end: SourceEnd, dropped: int) -> bool:
        """Whether the last frame has a pose, or all frames are answered or dropped."""
        if self.pose is not None and 0 <= end.last_index <= self.pose.index:
            return True
        return self.tracked + self.lost + dropped >= end.frame_count

    @property
    def has_worked(self) -> bool:
        """Whether more than one frame was tracked, in the map or in a fragment."""
        return self.tracked + self.in_fragments > 1

    def forget_map(self) -> None:
        """Forget the map after a reset; counts go on."""
        self.pose = self.map = None
        self.last_keyframe = -1

    def posed(self, pose: Pose, now_s: float) -> None:
        """Take in a pose; `now_s`: monotonic clock. The pose of a frame that was sent again counts once."""
        self.silence.posed()
        if pose.index <= self.newest_index.get(pose.publisher, -1):
            return
        self.newest_index.pop(pose.publisher, None)  # so that the last one that posed comes last
        self.newest_index[pose.publisher] = pose.index
        if len(self.newest_index) > _MOST_PUBLISHERS:
            del self.newest_index[next(iter(self.newest_index))]
        self.pose = pose
        self.tracked += pose.status != "lost"
        self.lost += pose.status == "lost"
        self.in_fragments += pose.fragment > 0
        latency_ms = self._latencies.of(pose.stamp_ns, pose.publish_ns, now_s)
        self.recent.append(PoseTimes(now_s, latency_ms))
        if latency_ms is not None:
            self.latency_bins.add(latency_ms)


class PoseTimes(NamedTuple):
    """Arrival of a pose, by the monotonic clock, and its latency; None: unknown, as a clock was set."""

    heard_s: float
    latency_ms: float | None


class Listener:
    """The supervisor's subscriptions, to all topics of small messages."""

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
        """Take in all received messages; returns the heartbeats and events among them."""
        state, now_s = self.state, time.monotonic()
        for pose in self._poses.drain():
            state.posed(pose, now_s)
        for version in self._maps.drain():
            state.map = version
        for keyframe in self._keyframes.drain():
            state.last_keyframe = max(state.last_keyframe, keyframe.id)
        for moved in self._corrections.drain():  # perhaps several of one round
            version = moved.map_epoch, moved.pose_version
            state.ba_rounds += version != state.pose_version
            state.pose_version = version
        state.source_end = self._end.poll() or state.source_end
        beats = self._health.drain()
        for health in beats:
            state.silence.heard(health, now_s)
        return beats, self._events.drain()
