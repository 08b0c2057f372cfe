"""Chooses the load level by the lateness of the poses in the last seconds."""

from collections import deque
from dataclasses import dataclass
from typing import Final

from hsslam_services.governor.levels import LEVELS

_WINDOW_S: Final = 2.0
_FEWEST_FRAMES: Final = 15  # for a meaningful share
_LATE_PERIODS: Final = 1.0  # beyond the least latency of the last minute
_UP_SHARE, _DOWN_SHARE = 0.05, 0.01  # shares of late or left-out frames
_TWO_UP_SHARE: Final = 0.25  # a larger share goes up two levels at once
_UP_AFTER_S: Final = 2.0  # since the last change: a level takes this long to have an effect
_CALM_S: Final = 10.0  # window in which few frames must be late to go down
_STALL_S: Final = 1.0  # late frames within this time are one stall, which no level prevents
_LOOK_EVERY_S: Final = 1.0  # between checks whether to go down: a check takes 0.2 ms
_DOWN_AFTER_S: Final = 10.0  # since the last change; doubles if the level went down too early
_LONGEST_DOWN_AFTER_S: Final = 160.0
_DOWN_THROTTLED: Final = 0.1  # share of throttled periods; with a larger one no level is left
_LONGEST_PERIOD_S: Final = 0.2
_MOST_LEFT_OUT: Final = 60  # at once
_BASELINE_S: Final = 30.0  # half of the window of the least latency


@dataclass(frozen=True)
class _Seen:
    at_s: float
    late: int
    frames: int


class _Share:
    """The share of late frames in the last `seconds`, over at least `fewest_frames`."""

    def __init__(self, seconds: float, fewest_frames: int = _FEWEST_FRAMES) -> None:
        self._seconds = seconds
        self._fewest_frames = fewest_frames
        self._seen: deque[_Seen] = deque()
        self.late = 0
        self.frames = 0

    def add(self, seen: _Seen) -> float:
        """Take in frames and forget old ones; returns the share, 0 to 1."""
        self._seen.append(seen)
        self.late += seen.late
        self.frames += seen.frames
        while (
            seen.at_s - self._seen[0].at_s > self._seconds
            and self.frames - self._seen[0].frames >= self._fewest_frames
        ):
            gone = self._seen.popleft()
            self.late -= gone.late
            self.frames -= gone.frames
        return self.late / self.frames

    def without_stall(self) -> float:
        """The share of late frames outside the worst second."""
        worst, stall = (0, 0), _Share(_STALL_S, fewest_frames=0)
        for seen in self._seen:
            stall.add(seen)
            worst = max(worst, (stall.late, stall.frames))
        late, frames = worst
        return (self.late - late) / max(self.frames - frames, 1)

    def clear(self) -> None:
        self._seen.clear()
        self.late = self.frames = 0


class Governor:
    """Raises the load level while frames are late or left out; lowers it after a calm period.

    A stall, as of a disk, makes the frames of a moment late. No level prevents stalls, so a stall neither
    raises the level nor keeps it up.

    A frame is late if its latency exceeds the least latency of the last minute by more than a frame period;
    the camera may thus have a clock of its own. If one of the two clocks is set, latencies are compared with
    those since then. A level that was left too early is kept twice as long the next time. Any level is kept
    while the kernel often throttles the service, because with more work it would throttle the service more
    often.

    Args:
        level: first level, such as that of the previous process.
    """

    def __init__(self, level: int = 0) -> None:
        self.level = min(max(level, 0), len(LEVELS) - 1)
        self.late_share = 0.0
        self._last_stamp_s: float | None = None
        self._recent, self._calm = _Share(_WINDOW_S), _Share(_CALM_S)
        self._least = [float("inf"), float("inf")]  # latency, s: previous and present half minute
        self._least_since_s = float("-inf")
        self._newest = float("inf"), float("-inf")  # latency, and time of publication, s
        self._changed_s: float | None = None  # time of the last change or of the first frame
        self._down_after_s = _DOWN_AFTER_S
        self._went_down = False
        self._look_again_s = 0.0

    def frame(
        self,
        now_s: float,
        left_out: int,
        stamp_s: float,
        latency_s: float,
        throttled_share: float = 0.0,
    ) -> bool:
        """Take in a published pose; returns whether the level changes.

        Args:
            now_s: time of publication by the monotonic clock, s.
            left_out: number of frames since the last pose that the service left out.
            stamp_s: of the sensor, s.
            latency_s: from the stamp to the pose, s; the two clocks may have an offset.
            throttled_share: of the last 10 s, see `Throttling`.
        """
        left_out = min(left_out, _MOST_LEFT_OUT)
        period_s = self._period_s(left_out, stamp_s)
        late_s = latency_s - self._baseline(now_s, latency_s)
        late = left_out + (late_s > _LATE_PERIODS * period_s)
        seen = _Seen(now_s, late, 1 + left_out)
        self.late_share, late_of_calm = self._recent.add(seen), self._calm.add(seen)
        if self._changed_s is None:
            self._changed_s = now_s
        at_level_s = now_s - self._changed_s
        if self._recent.frames < _FEWEST_FRAMES:
            return False
        if self.late_share > _UP_SHARE and at_level_s >= _UP_AFTER_S:
            return self._recent.without_stall() > _UP_SHARE and self._up(now_s, at_level_s)
        if at_level_s < self._down_after_s or now_s < self._look_again_s:
            return False
        self._look_again_s = now_s + _LOOK_EVERY_S
        if throttled_share > _DOWN_THROTTLED:
            return False
        is_calm = late_of_calm <= _DOWN_SHARE or self._calm.without_stall() <= _DOWN_SHARE
        return is_calm and self._down(now_s)

    def _period_s(self, left_out: int, stamp_s: float) -> float:
        """The period of the camera, s."""
        last_s, self._last_stamp_s = self._last_stamp_s, stamp_s
        if last_s is None or stamp_s <= last_s:  # the camera has begun anew
            return _LONGEST_PERIOD_S
        return min((stamp_s - last_s) / (1 + left_out), _LONGEST_PERIOD_S)

    def _baseline(self, now_s: float, latency_s: float) -> float:
        if now_s - self._least_since_s > _BASELINE_S:
            self._least = [self._least[1], float("inf")]
            self._least_since_s = now_s
        if self._was_clock_set(now_s, latency_s):
            self._least = [float("inf"), float("inf")]
        self._least[1] = min(self._least[1], latency_s)
        return min(self._least)

    def _was_clock_set(self, now_s: float, latency_s: float) -> bool:
        """Whether the latency has risen by more than the time since the last pose, so not by lateness.

        A rise by more than `_STALL_S` counts too: a clock may be set in a pause.
        """
        (before_s, at_s), self._newest = self._newest, (latency_s, now_s)
        return latency_s - before_s > min(now_s - at_s, _STALL_S)

    def _up(self, now_s: float, at_level_s: float) -> bool:
        if self.level == len(LEVELS) - 1:
            return False
        if self._went_down and at_level_s < self._down_after_s:
            self._down_after_s = min(2 * self._down_after_s, _LONGEST_DOWN_AFTER_S)
        self._went_down = False
        by = 2 if self.late_share > _TWO_UP_SHARE else 1
        return self._change(now_s, min(by, len(LEVELS) - 1 - self.level))

    def _down(self, now_s: float) -> bool:
        if self.level == 0:
            self._down_after_s = _DOWN_AFTER_S
            return False
        self._went_down = True
        return self._change(now_s, -1)

    def _change(self, now_s: float, by: int) -> bool:
        self.level += by
        self._changed_s = now_s
        self._recent.clear()
        self._calm.clear()
        return True
