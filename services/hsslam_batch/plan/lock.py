"""The lock of a batch; apart, as `plan` and `run` take it."""

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path

from hsslam_node.errors import UserError

_LOCK = ".lock"


@contextlib.contextmanager
def alone(folder: Path, place: str) -> Iterator[None]:
    """Own the batch in a folder of this machine in the block; `place`: the batch as users name it.

    Raises:
        UserError: another process owns it.
        OSError: the folder cannot be written.
    """
    with (folder / _LOCK).open("wb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"{place}: hsslam-batch run or plan is at work on it: expected one at a time"
            ) from None
        except OSError:
            pass  # a file system without locks
        yield
