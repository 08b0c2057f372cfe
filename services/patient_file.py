"""A file that outlives a full disk."""

import contextlib
import errno
import fcntl
import os
from pathlib import Path

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class PatientFile:
    """Sequential output that keeps in memory, in order, what a full disk refuses, and tries again.

    The file is locked (flock) while it is open, so that others see that it grows.
    Positions (`tell`) count what was accepted, so an index written through it stays right.
    Errors other than a full disk are raised as OSError.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._pending = bytearray()
        self._position = 0

    @property
    def pending_bytes(self) -> int:
        """Bytes that wait for room on the disk; 0 in health."""
        return len(self._pending)

    def write(self, data: bytes) -> int:
        """Accept all of `data`."""
        self._position += len(data)
        if self._pending:
            self._pending += data
            self.flush()
            return len(data)
        view = memoryview(data)
        while view:
            written = self._try_write(view)
            if written == 0:
                self._pending += view
                break
            view = view[written:]
        return len(data)

    def flush(self) -> None:
        """Try to write what waits."""
        while self._pending:
            written = self._try_write(self._pending)
            if written == 0:
                return
            del self._pending[:written]

    def tell(self) -> int:
        """Bytes accepted so far."""
        return self._position

    def close(self) -> None:
        """Try once more, then close; `pending_bytes` are lost."""
        self.flush()
        os.close(self._fd)

    def _try_write(self, data: bytes | bytearray | memoryview) -> int:
        try:
            return os.write(self._fd, data)
        except OSError as error:
            if error.errno in _FULL:
                return 0
            raise
