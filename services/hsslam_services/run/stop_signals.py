"""The signals that end a run in order; alone, as the service and the runs of a batch obey the same."""

import signal
from collections.abc import Callable
from types import FrameType


def hear_stop_signals(handler: Callable[[int, FrameType | None], object]) -> None:
    """Call `handler` on SIGINT, SIGTERM and SIGHUP; a SIGHUP that `nohup` ignores stays ignored."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)
