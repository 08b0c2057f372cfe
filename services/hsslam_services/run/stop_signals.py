"""The signals that end a run in order, and the one that ends its processes; alone, as batches use them."""

import signal
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Any

# of one process, when its supervisor ends it or dies; systemd and others send SIGTERM to all at once.
# SIGUSR1 and SIGUSR2 would not arrive: LLVM, with which Triton compiles kernels for a GPU, handles them
END_SIGNAL = signal.SIGRTMIN


def hear_stop_signals(tell: Callable[[int], object]) -> Mapping[signal.Signals, Any]:
    """Call `tell` on SIGINT, SIGTERM and SIGHUP with their number so far; returns the former handlers.

    A SIGHUP counts only if no other signal comes: systemd-logind sends it with a SIGTERM (Python may see it
    first), a shell and the kernel each send one. If `nohup` ignores SIGHUP, it stays ignored.
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


def leave_stop_signals_to_supervisor() -> None:
    """Ignore the stop signals that systemd or the end of a session sends to all processes of a run: the
    supervisor ends them in order. Programs that this process starts still end by SIGINT and SIGTERM."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
