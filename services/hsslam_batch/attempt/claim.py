"""The claim of an attempt on a folder of this machine: a file that it locks as long as it lives.

So other attempts know which folders they may remove. File systems without locks keep all folders. NFS takes a
shared lock only of a file that can be read, and an exclusive one only of a file that can be written.
"""

import contextlib
import fcntl
import os
import platform
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from hsslam_batch.attempt.fetch import remove_fetched
from hsslam_batch.plan.batch import FETCHED

LOCK = ".lock"
"""A file beside the folders, which stays; it is empty."""
_CLAIM = ".claim"  # bytes that the folder may take, and the name of the machine
_UNUSED_S = 3600.0
_UNUSED_FETCH_S = 86400.0  # the next `run` may continue from what was fetched


@contextlib.contextmanager
def held_claim(folder: Path) -> Iterator[int]:
    """Make a folder and hold its claim in the block, with 0 bytes at first; gives the descriptor of its file.

    Attempts at the same log may hold it at once.

    Raises:
        OSError: the folder cannot be written.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with locked(folder.parent):
        folder.mkdir(exist_ok=True)
        stream = (folder / _CLAIM).open("a+b")
        if is_alone(stream.fileno()):
            write_claim(stream.fileno(), 0)
        with contextlib.suppress(OSError):
            fcntl.flock(stream, fcntl.LOCK_SH)
    with stream:
        yield stream.fileno()


def write_claim(claim_fd: int, nbytes: int) -> None:
    """Write how many bytes the folder may take."""
    os.truncate(claim_fd, 0)
    os.write(claim_fd, b"%d %s" % (nbytes, _here()))


def is_alone(claim_fd: int) -> bool:
    """Whether no other attempt holds the claim; true on a file system without locks."""
    try:
        fcntl.flock(claim_fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def held_claims(parent: Path) -> Iterator[tuple[Path, int]]:
    """The folders in a folder whose attempts live, and the bytes that each may take."""
    for claim in parent.glob(f"*/{_CLAIM}"):
        with contextlib.suppress(OSError), _opened(claim) as stream:  # it may be gone
            if not is_alone(stream.fileno()):
                yield claim.parent, int(stream.read().partition(b" ")[0] or 0)


def remove_ended(parent: Path, but: Path | None = None) -> None:
    """Remove the folders in a folder whose attempts have ended on this machine, except `but` and those in
    which something has changed in the last hour, or in the last day for fetched logs."""
    with contextlib.suppress(OSError), locked(parent):
        for folder, changed_s in ended_claims(parent):
            if folder != but and time.time() - changed_s >= _unused_s(folder):
                remove_fetched(folder)


def ended_claims(parent: Path) -> list[tuple[Path, float]]:
    """The folders in a folder whose attempts have ended on this machine, and when something in each last
    changed, s since 1970; the oldest first. It stays so while `parent` is locked."""
    found = []
    for claim in parent.glob(f"*/{_CLAIM}"):
        with contextlib.suppress(OSError), claim.open("rb+") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)  # OSError: it lives
            if stream.read().partition(b" ")[2] == _here():
                found.append((claim.parent, _changed_s(claim.parent)))
    return sorted(found, key=lambda each: each[1])


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder of such folders in the block, against other attempts of this user; without effect on a
    file system without locks.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    try:
        fd = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    except PermissionError:  # it is of another user
        fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(fd, fcntl.LOCK_EX)
        yield
    finally:
        os.close(fd)


def _opened(claim: Path) -> BinaryIO:
    """A claim, opened so that its lock can be tried; a claim of another user only for reading.

    Raises:
        OSError: it is gone.
    """
    try:
        return claim.open("rb+")
    except PermissionError:
        return claim.open("rb")


def _here() -> bytes:
    """The name of this machine."""
    return os.fsencode(platform.node())


def _unused_s(folder: Path) -> float:
    """How long a folder stays unused, s."""
    return _UNUSED_FETCH_S if folder.name.endswith(FETCHED) else _UNUSED_S


def _changed_s(folder: Path) -> float:
    """When something below a folder last changed, s since 1970."""
    return max(path.stat().st_mtime for path in folder.rglob("*"))
