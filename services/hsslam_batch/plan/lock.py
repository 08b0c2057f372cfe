"""The lock of a batch; apart, as both `plan` and `run` take it."""

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path

from hsslam_node.errors import UserError

_LOCK = ".lock"


@contextlib.contextmanager
def alone(folder: Path, place: str) -> Iterator[None]:
    """Lock the batch in a folder of this machine in the block; `place`: the batch as users write it.

    Raises:
        UserError: another process holds the lock.
        OSError: the folder is not writable.
    """
    with (folder / _LOCK).open("wb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"{place}: another hsslam-batch run or plan uses it: expected one at a time"
            ) from None
        except OSError:
            pass  # a file system without locks
        yield
