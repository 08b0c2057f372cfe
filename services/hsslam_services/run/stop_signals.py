"""The signals that end a run in order; alone, as the service and the runs of a batch obey the same."""

import signal
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Any


def hear_stop_signals(tell: Callable[[int], object]) -> Mapping[signal.Signals, Any]:
    """Call `tell` on SIGINT, SIGTERM and SIGHUP with how many have come; the former handlers.

    A SIGHUP counts only if nothing else comes: systemd-logind sends it with a SIGTERM (Python may see it
    first), a shell and the kernel each send one. One that `nohup` ignores stays ignored.
    """
    others = 0

    def hear(number: int, _frame: FrameType | None) -> None:
        nonlocal others
        others += number != signal.SIGHUP
        tell(max(others, 1))

    heard = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        heard.append(signal.SIGHUP)
    return {number: signal.signal(number, hear) for number in heard}
