"""What happens if a parent process dies; apart, as the one place that calls prctl."""

import ctypes
import signal

_LIBC = ctypes.CDLL(None)  # loaded at import: between fork and exec nothing can be imported
_PR_SET_PDEATHSIG = 1  # <sys/prctl.h>
_PR_SET_CHILD_SUBREAPER = 36


def die_with_parent(number: signal.Signals) -> None:
    """Let the kernel send this signal to this process when its parent dies."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, number)


def adopt_orphans() -> None:
    """Become the parent of descendants whose parent ends (subreaper)."""
    _LIBC.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
