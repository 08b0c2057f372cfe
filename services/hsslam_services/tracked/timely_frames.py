"""Chooses the frames that the tracker tracks in real time: each one, or the newest if it is behind."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from hsslam_proto.messages import Frame
from hsslam_services.bus.subscription import Received, Subscription

DEPTH: Final = 3  # of the subscription


class TimelyFrames:
    """A subscription to frames for a tracker that must not fall behind.

    A camera that was held up sends several frames at once. The tracker gets all of them, in their order.
    If the tracker is slower than the camera, this class drops frames: it drops a frame if a newer one waits
    too, and the frame has waited for more than half of the time between their stamps. `missed` of the newer
    one counts it.

    `now_ns`: the monotonic clock, ns.
    """

    def __init__(
        self, frames: Subscription[Frame], now_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._frames = frames
        self._now_ns = now_ns
        self._next: Received[Frame] | None = None

    def wait_received(self, timeout_s: float) -> Received[Frame] | None:
        """The next frame; waits up to `timeout_s` for one."""
        oldest, self._next = self._next, None
        if oldest is None:
            oldest = self._frames.wait_received(timeout_s)
        if oldest is None:
            return None
        while (newer := self._frames.poll_received()) is not None:
            if not self._is_late(oldest, newer):
                self._next = newer
                break
            self._frames.drop()
            oldest = replace(newer, missed=oldest.missed + 1 + newer.missed)
        return oldest

    def _is_late(self, older: Received[Frame], newer: Received[Frame]) -> bool:
        period_ns = newer.message.stamp_ns - older.message.stamp_ns
        return 2 * (self._now_ns() - older.arrival_monotonic_ns) > period_ns
