"""Exceptions whose text is meant for the user; a file of its own, as every folder imports it."""

import difflib
import errno
from collections.abc import Iterable

MORE_SHARED_MEMORY = "expected more shared memory (docker: --shm-size)"
"""In each error about a full /dev/shm; a batch, whose runs are other processes, recognises them by it."""
GPU_IS_FULL = "GPU memory is full"
"""In each error about the memory of a GPU, likewise."""
OUT_OF_MEMORY = "out of memory"
"""In each error about the main memory, likewise."""
TOO_FEW_FILES = "ulimit -n"
"""In each error about open files, likewise."""
STORAGE_FAILS = (errno.EIO, errno.ESTALE, errno.ETIMEDOUT, errno.ENOTCONN, errno.EREMOTEIO)
"""Errors of a disk or of its network, which may pass: the file is not at fault."""
_LONGEST_TEXT = 300


class UserError(Exception):
    """Bad input. Its text is one line: the file, topic, field or option, the value, what was expected.

    Command-line entry points print the message without a traceback and exit with code 2.
    """


class OutOfMemoryError(UserError):
    """A run needs more memory than there is; unlike other bad input, it cannot be skipped."""


def one_line(error: BaseException) -> str:
    """Type and text of another package's error, on one line for users, at most 300 characters of it."""
    text = on_one_line(str(error))
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def on_one_line(text: str) -> str:
    """A text that may be of another package, without line breaks; at most 300 characters of it."""
    return " ".join(text.split())[:_LONGEST_TEXT]


def did_you_mean(name: str, known: Iterable[str], cutoff: float = 0.5) -> str:
    """`; did you mean NAME?` with the nearest of the known names; empty if none is near."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return f"; did you mean {near[0]}?" if near else ""
