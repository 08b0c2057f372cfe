"""Room for fetched logs on the disk of a node: an attempt waits until its log fits beside those of others.

All attempts at logs of a store, also those of other batches, have their folders in one folder. Each locks a
file in its own folder as long as it lives, so that the others know which logs will be removed.
"""

import contextlib
import errno
import fcntl
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from hsslam_batch.attempt.fetch import remove_fetched
from hsslam_batch.plan.folder_size import folder_nbytes

_CLAIM = ".claim"  # in the folder of a log: its size in bytes


class SmallDiskError(OSError):
    """The whole disk is smaller than a log."""


@dataclass
class Room:
    """A folder with room for a log. `is_kept`: the folder stays at the end, for a next attempt."""

    is_kept: bool = False


@dataclass(frozen=True)
class _Other:
    """The log of another attempt that lives: bytes on the disk, and bytes still to come."""

    here: int
    rest: int


@contextlib.contextmanager
def room_for(nbytes: int, folder: Path, pause: Callable[[], None]) -> Iterator[Room]:
    """Make a folder for a log of `nbytes` bytes, wait for room on its disk, and remove it after the block,
    unless another attempt at this log uses it.

    While the logs of other attempts take the room, it calls `pause` and looks again.

    Raises:
        SmallDiskError: the log would not fit on the disk if it were empty.
        OSError: the log would not fit if the logs of all other attempts were removed, or the folder cannot be
            written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    room = Room()
    with (folder / _CLAIM).open("ab") as stream:
        try:
            while not _claimed(nbytes, folder, stream.fileno()):
                pause()
            yield room
        finally:  # before the others find that this attempt has ended
            if not room.is_kept and _is_alone(stream.fileno()):
                remove_fetched(folder)


def _claimed(nbytes: int, folder: Path, claim_fd: int) -> bool:
    """Whether the log fits now and its room is claimed."""
    with _locked(folder.parent):
        usage, lack = shutil.disk_usage(folder), nbytes - folder_nbytes(folder)
        others = list(_others(folder))
        if lack + sum(other.rest for other in others) <= usage.free:
            os.truncate(claim_fd, 0)
            os.write(claim_fd, str(nbytes).encode())
            with contextlib.suppress(OSError):  # a file system without locks
                fcntl.flock(claim_fd, fcntl.LOCK_SH)
            return True
    if nbytes > usage.total:
        text = f"a disk of {usage.total / 1e6:.1f} MB, {nbytes / 1e6:.1f} MB needed"
        raise SmallDiskError(errno.EFBIG, text, str(folder.parent))
    if lack > (most := usage.free + sum(other.here for other in others)):
        text = f"{most / 1e6:.1f} MB free, {lack / 1e6:.1f} MB needed"
        raise OSError(errno.ENOSPC, text, str(folder.parent))
    return False


def _is_alone(claim_fd: int) -> bool:
    """Whether no other attempt at the same log uses the folder; true on a file system without locks."""
    try:
        fcntl.flock(claim_fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def _others(folder: Path) -> Iterator[_Other]:
    """The logs of all other attempts that live and have their room."""
    for claim in folder.parent.glob(f"*/{_CLAIM}"):
        if claim.parent != folder and (nbytes := _claim(claim)):
            here = folder_nbytes(claim.parent)
            yield _Other(here, max(0, nbytes - here))


def _claim(path: Path) -> int:
    """Bytes that an attempt has claimed; 0 if it has none or has ended."""
    try:
        with path.open("rb") as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return int(stream.read() or 0)
    except OSError:  # it is gone, or there are no locks
        pass
    return 0


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock the folder of all logs in the block; without effect on a file system without locks."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(fd, fcntl.LOCK_EX)
        yield
    finally:
        os.close(fd)
