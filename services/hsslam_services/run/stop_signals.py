"""The signals that end a run in order, and the one that ends its processes; alone, as batches use them."""

import math
import signal
import time
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Any

# of one process, when its supervisor ends it or dies; systemd and others send SIGTERM to all at once.
# SIGUSR1 and SIGUSR2 would not arrive: LLVM, with which Triton compiles kernels for a GPU, handles them
END_SIGNAL = signal.SIGRTMIN
ONE_REQUEST_S = 0.5


def hear_stop_signals(tell: Callable[[int], object]) -> Mapping[signal.Signals, Any]:
    """Call `tell` on SIGINT, SIGTERM and SIGHUP with the number of requests so far, each time it grows.

    Returns the former handlers. Signals within half a second are one request: `timeout` sends its signal to
    its command and then to the group, and programs such as `uv run` pass on a Ctrl-C that both have heard.
    A SIGHUP counts only if no other signal comes: systemd-logind sends it with a SIGTERM (Python may see it
    first), a shell and the kernel each send one. If `nohup` ignores SIGHUP, it stays ignored.
    """
    told = others = 0
    last_s = -math.inf

    def hear(number: int, _frame: FrameType | None) -> None:
        nonlocal told, others, last_s
        now_s = time.monotonic()
        if number != signal.SIGHUP and now_s - last_s > ONE_REQUEST_S:
            others, last_s = others + 1, now_s
        if (count := max(others, 1)) > told:
            told = count
            tell(count)

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
