"""Sets the shared load level from the tracker's poses, and reports changes; only in real time."""

from collections.abc import Callable

from hsslam_services.governor.governor import Governor
from hsslam_services.governor.levels import LEVELS
from hsslam_services.governor.shared_level import SharedLevel
from hsslam_services.governor.throttling import Throttling

_FULL_CORES, _SCARCE_CORES = 1.9, 1.4  # with fewer, the run starts at a higher level


def first_level(cores: float) -> int:
    """The first load level of a service that may use `cores` cores."""
    if cores >= _FULL_CORES:
        return 0
    return 2 if cores >= _SCARCE_CORES else 5


class LatencyGovernor:
    """Raises the load level of the service if poses come late.

    Args:
        shared: starts at its level, or at the first level of `cores` if that is higher.
        cores: that the service may use; infinite: no limit.
        throttling: of the service.
        report: takes the text of an event.
        count: increments the counter of a name.
    """

    def __init__(
        self,
        shared: SharedLevel,
        cores: float,
        throttling: Throttling,
        report: Callable[[str], None],
        count: Callable[[str], None],
    ) -> None:
        self._shared, self._report, self._count = shared, report, count
        self._throttling = throttling
        first = first_level(cores)
        self._governor = Governor(max(shared.number, first))
        if self.level > shared.number:
            shared.number = self.level
            report(f"{self._in_words()}: this service may use {cores:.1f} cores")

    @property
    def level(self) -> int:
        """The current load level."""
        return self._governor.level

    def frame(
        self, now_s: float, left_out: int, stamp_ns: int, publish_ns: int, source_wait_ns: int = 0
    ) -> None:
        """Take in a published pose.

        Args:
            now_s: time of publication by the monotonic clock, s.
            left_out: number of frames since the last pose that the service left out.
            stamp_ns, publish_ns: of the sensor and of the pose; the two clocks may have an offset, and may be
                set.
            source_wait_ns: how late the frame came because its source waited; no level changes that.
        """
        late = self._governor.late_share
        latency_s = (publish_ns - stamp_ns - source_wait_ns) / 1e9
        throttled_share = self._throttling.share(now_s)
        if self._governor.frame(now_s, left_out, stamp_ns / 1e9, latency_s, throttled_share):
            self._shared.number = self.level
            self._count("load level changes")
            self._report(f"{self._in_words()}: {late:.0%} of the frames are late")
        self._count(f"frames at load level {self.level}")

    def _in_words(self) -> str:
        return f"load level {self.level} of {len(LEVELS) - 1} ({LEVELS[self.level].in_words})"
