"""Faults that only a series of a sensor's messages shows; alone, as odometry, IMU and cameras share it."""

from collections.abc import Callable

# a larger step back: the clock was set; a smaller one: perhaps messages out of order
STEP_BACK_S = 1.0
_EARLY, _EARLY_S = 5, 0.1  # that follow each other, and their span: the clock was set after all
_FRAMES = 30  # in a row without a reading
_MOTIONS = 30  # in a row, of which most are jumps or not


class SensorWatch:
    """Notices faults of a track of messages.

    Args:
        report: gets a fault in a few words, and the rest of the sentence.
    """

    def __init__(self, report: Callable[[str, str], None] = lambda fault, rest: None) -> None:
        self._report = report
        self._frames_without = self._motions = self._jumps = 0
        self._is_too_fast = False  # whether most of the last 30 motions that were judged were jumps

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
        """Note a motion between two messages; a jump is too fast for a robot.

        Each 30 motions are judged anew: a robot that stands shows no wrong unit, and a second publisher may
        begin later.
        """
        self._motions += 1
        self._jumps += is_jump
        if self._motions < _MOTIONS:
            return
        was_too_fast, self._is_too_fast = self._is_too_fast, self._jumps > _MOTIONS // 2
        if self._is_too_fast and not was_too_fast:
            self._report(
                "too fast for a robot",
                f": {self._jumps} of {_MOTIONS} motions count as jumps; expected metres and radians, of one "
                "publisher",
            )
        self._motions = self._jumps = 0


class StampOrder:
    """Distinguishes messages out of order from a clock that was set back.

    After a step back of at most 1 s, messages with stamps before the newest one are left out, until five or
    more have followed each other for 0.1 s: then the clock was set.
    """

    def __init__(self) -> None:
        self._early_ns: list[int] = []  # stamps of the early messages since the last one in order

    @property
    def is_doubtful(self) -> bool:
        """Whether the last messages were early, so that those before them may have another time."""
        return len(self._early_ns) > 1

    def set_back_s(self, stamp_ns: int, newest_ns: int) -> float:
        """Take the next message; returns by how much the clock was set back, s; 0: it was not."""
        if stamp_ns > newest_ns:
            self._early_ns.clear()
            return 0.0
        if self._early_ns and stamp_ns <= self._early_ns[-1]:
            self._early_ns.clear()
        self._early_ns.append(stamp_ns)
        is_long = stamp_ns - self._early_ns[0] >= 1e9 * _EARLY_S
        is_set = newest_ns - stamp_ns > 1e9 * STEP_BACK_S
        if not is_set and not (is_long and len(self._early_ns) >= _EARLY):
            return 0.0
        back_ns = newest_ns - self._early_ns[0]
        self._early_ns.clear()
        return 1e-9 * back_ns
