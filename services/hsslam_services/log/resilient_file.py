"""The file of a log: it survives a full disk, and a power cut costs only the last seconds."""

import contextlib
import errno
import fcntl
import os
import threading
from pathlib import Path

from hsslam_node.durable_file import sync_folder

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class ResilientFile:
    """A new file for sequential output; if the disk is full, it keeps the data in memory and tries again.

    The file is locked (flock) while it is open, so that others see that it is still written. `sync` writes
    to disk in another thread: a slow disk delays no writer. `tell` counts accepted bytes, so offsets in an
    index stay right. Errors other than a full disk raise OSError.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._pending = bytearray()
        self._position = 0
        self._syncing = _Syncing(self._fd, path.parent)

    @property
    def pending_bytes(self) -> int:
        """Bytes that wait for room on a full disk; normally 0."""
        return len(self._pending)

    @property
    def sync_error(self) -> str:
        """Error of the first failed sync of the file to disk, whose data may be lost; normally empty."""
        return self._syncing.error

    def write(self, data: bytes) -> int:
        """Write `data`, or keep it in memory if the disk is full."""
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
        """Try to write the waiting bytes."""
        while self._pending:
            written = self._try_write(self._pending)
            if written == 0:
                return
            del self._pending[:written]

    def sync(self) -> None:
        """Start to sync to disk; returns at once."""
        self._syncing.request()

    def tell(self) -> int:
        """Bytes accepted so far."""
        return self._position

    def release(self) -> None:
        """Flush; bytes that still wait are lost. Another thread syncs to disk and closes the file."""
        self.flush()
        self._syncing.stop()

    def wait_until_closed(self) -> None:
        """Wait for the end of `release`."""
        self._syncing.join()

    def _try_write(self, data: bytes | bytearray | memoryview) -> int:
        try:
            return os.write(self._fd, data)
        except OSError as error:
            if error.errno in _FULL:
                return 0
            raise


class _Syncing(threading.Thread):
    """Syncs the folder first, then the file at each request and at the end; closes it."""

    def __init__(self, fd: int, folder: Path) -> None:
        super().__init__(name="log sync", daemon=True)
        self.error = ""
        self._fd = fd
        self._folder = folder
        self._requested = threading.Event()
        self._stopped = False
        self.start()

    def request(self) -> None:
        self._requested.set()

    def stop(self) -> None:
        self._stopped = True
        self._requested.set()

    def run(self) -> None:
        with contextlib.suppress(OSError):  # the file is there, if the machine goes on
            sync_folder(self._folder)
        is_last = False
        while not is_last:
            self._requested.wait()
            self._requested.clear()
            is_last = self._stopped
            try:
                os.fdatasync(self._fd)
            except OSError as error:  # the kernel forgets the data: no later sync brings them back
                self.error = self.error or str(error.strerror)
        os.close(self._fd)
