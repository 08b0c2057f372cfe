"""`hsslam-serve` as a user runs it, for tests: a live run, and what it must leave."""

from hsslam_bench.runs import live_run
from hsslam_bench.runs.live_run import QUICK, LiveRun

__all__ = ["QUICK", "SENT_ROOM", "SMALL_ROOM", "ServeProcess"]

_QUICK_END = ("--slam.mapper.last-iterations", "1")  # a keyframe; no test asks how good the map is
SMALL_ROOM = (*live_run.SMALL_ROOM, *_QUICK_END)
SENT_ROOM = (*live_run.SENT_ROOM, *_QUICK_END)


class ServeProcess(LiveRun):
    """A running `hsslam-serve` that a test watches."""

    def expect_nothing_left(self, timeout_s: float = 0.0) -> None:
        """No process, no shared memory and no port of the run, at the latest after `timeout_s`."""
        left = self.left_behind(timeout_s)
        assert not left, left
