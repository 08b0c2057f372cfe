"""Faults that only a series of a sensor's messages shows; odometry and IMU share it, so it stands alone."""

_FRAMES = 30  # in a row without a reading
_MOTIONS = 30  # before jumps are judged


class SensorWatch:
    """Notices faults of a track of messages. A subclass reports them; this class does not."""

    def __init__(self) -> None:
        self._frames_without = self._motions = self._jumps = 0

    def asked(self, stamp_ns: int, newest_ns: int | None, *, is_known: bool) -> None:
        """Note stamps of a frame and of the newest message (None: none yet); `is_known`: it has a reading."""
        is_missing = newest_ns is not None and not is_known
        self._frames_without = self._frames_without + 1 if is_missing else 0
        if newest_ns is not None and self._frames_without == _FRAMES:
            self.not_near(_FRAMES, 1e-9 * (newest_ns - stamp_ns))

    def moved(self, *, is_jump: bool) -> None:
        """Note a motion between two messages."""
        self._motions += 1
        self._jumps += is_jump
        if self._motions == _MOTIONS and self._jumps > _MOTIONS // 2:
            self.jumps(self._jumps, _MOTIONS)

    def clock_set_back(self, seconds: float) -> None:
        """Stamps went back by this time, and not because messages changed order."""

    def not_near(self, frames: int, ahead_s: float) -> None:
        """This many frames in a row have no message near; the newest is this time after the last of them."""

    def jumps(self, count: int, motions: int) -> None:
        """`count` of the first `motions` motions are too fast for a robot."""
