"""Room for fetched logs on the disk of a node: an attempt waits until its log fits beside those of others.

All attempts at logs of a store, also those of other batches, have their folders in one folder. Each holds the
claim of its own folder, so that the others know which logs will be removed.
"""

import contextlib
import errno
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from hsslam_batch.attempt.claim import (
    ended_claims,
    held_claim,
    held_claims,
    is_alone,
    locked,
    write_claim,
)
from hsslam_batch.attempt.fetch import remove_fetched
from hsslam_batch.plan.folder_size import folder_nbytes


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

    If the room is short, it removes what attempts that have ended have left, the oldest first, until the log
    fits. While the logs of other attempts take the room, it calls `pause` and looks again.

    Raises:
        SmallDiskError: the log would not fit on the disk if it were empty.
        OSError: the log would not fit if the logs of all other attempts were removed, or the folder cannot be
            written.
    """
    room = Room()
    with held_claim(folder) as claim_fd:
        try:
            while not _claimed(nbytes, folder, claim_fd):
                pause()
            yield room
        finally:  # before the others find that this attempt has ended
            if not room.is_kept:
                with (
                    contextlib.suppress(OSError),
                    locked(folder.parent),
                ):  # no attempt at this log begins
                    if is_alone(claim_fd):
                        remove_fetched(folder)


def _claimed(nbytes: int, folder: Path, claim_fd: int) -> bool:
    """Whether the log fits now and its room is claimed; removes what attempts have left if it may fit so."""
    with locked(folder.parent):
        while True:
            usage, lack = shutil.disk_usage(folder), nbytes - folder_nbytes(folder)
            others = list(_others(folder))
            if lack + sum(other.rest for other in others) <= usage.free:
                write_claim(claim_fd, nbytes)
                return True
            if nbytes > usage.total:
                text = f"a disk of {usage.total / 1e6:.1f} MB, {nbytes / 1e6:.1f} MB needed"
                raise SmallDiskError(errno.EFBIG, text, str(folder.parent))
            left = [each for each, _ in ended_claims(folder.parent)]
            most = usage.free + sum(other.here for other in others) + sum(map(folder_nbytes, left))
            if lack > most:
                text = f"{most / 1e6:.1f} MB free, {lack / 1e6:.1f} MB needed"
                raise OSError(errno.ENOSPC, text, str(folder.parent))
            if not any(map(_removed, left)):
                return False


def _removed(folder: Path) -> bool:
    """Remove a folder; returns whether it is gone."""
    remove_fetched(folder)
    return not folder.exists()


def _others(folder: Path) -> Iterator[_Other]:
    """The logs of all other attempts that live and have their room."""
    for other, nbytes in held_claims(folder.parent):
        if other != folder and nbytes:
            here = folder_nbytes(other)
            yield _Other(here, max(0, nbytes - here))
