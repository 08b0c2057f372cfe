"""Faults that only a series of a sensor's messages shows; alone, as odometry, IMU and cameras share it."""

from collections.abc import Callable

STEP_BACK_S = 1.0  # a larger step back: the clock was set; a smaller one: messages out of order
_FRAMES = 30  # in a row without a reading
_MOTIONS = 30  # before jumps are judged


class SensorWatch:
    """Notices faults of a track of messages.

    Args:
        report: gets a fault in a few words, and the rest of the sentence.
    """

    def __init__(self, report: Callable[[str, str], None] = lambda fault, rest: None) -> None:
        self._report = report
        self._frames_without = self._motions = self._jumps = 0

    def clock_set_back(self, seconds: float) -> None:
        """Report that stamps went back by this time, and not because messages changed order."""
        rest = f" by {seconds:.1f} s: motion is measured from the new time"
        self._report("clock set back", rest)

    def asked(self, stamp_ns: int, newest_ns: int | None, *, is_known: bool) -> None:
        """Note stamps of a frame and of the newest message (None: none yet); `is_known`: it has a reading."""
        if newest_ns is None or is_known:
            self._frames_without = 0
            return
        self._frames_without += 1
        if self._frames_without == _FRAMES:
            ahead_s = 1e-9 * (newest_ns - stamp_ns)
            where = f"{abs(ahead_s):.2f} s {'after' if ahead_s > 0 else 'before'} the frame"
            self._report(
                "no message near the frames",
                f": {_FRAMES} frames in a row, the newest message is {where}; expected stamps of the same "
                "clock",
            )

    def moved(self, *, is_jump: bool) -> None:
        """Note a motion between two messages; a jump is too fast for a robot."""
        self._motions += 1
        self._jumps += is_jump
        if self._motions == _MOTIONS and self._jumps > _MOTIONS // 2:
            self._report(
                "too fast for a robot",
                f": {self._jumps} of {_MOTIONS} motions count as jumps; expected metres and radians",
            )
