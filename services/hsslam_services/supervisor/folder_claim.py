"""A lock that allows one run at a time in a folder; alone, as start and end of a run share it."""

import contextlib
import fcntl
import os
from pathlib import Path

from hsslam_node.errors import UserError


class FolderClaim:
    """A lock on a run folder, which the kernel frees when this process dies.

    Raises:
        UserError: another process holds the lock.
        OSError: the folder cannot be opened.
    """

    def __init__(self, run_dir: Path) -> None:
        self._fd = os.open(run_dir, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._fd)
            raise UserError(
                f"--out {run_dir}: in use by another run: expected another folder"
            ) from None
        except OSError:
            pass  # a file system without locks

    def close(self) -> None:
        """Release the lock."""
        with contextlib.suppress(OSError):
            os.close(self._fd)
