"""`hsslam-serve` as a user runs it, for tests: a live run, and what it must leave."""

from hsslam_bench.runs.live_run import QUICK, SENT_ROOM, SMALL_ROOM, LiveRun

__all__ = ["QUICK", "SENT_ROOM", "SMALL_ROOM", "ServeProcess"]


class ServeProcess(LiveRun):
    """A running `hsslam-serve` that a test watches."""

    def expect_nothing_left(self, timeout_s: float = 0.0) -> None:
        """No process, no shared memory and no port of the run, at the latest after `timeout_s`."""
        left = self.left_behind(timeout_s)
        assert not left, left
