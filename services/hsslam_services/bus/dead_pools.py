"""Counts zenoh's shared memory of a run, frees the pools of killed processes, and removes unused files.

A sender's pool is a file in /dev/shm. If its process is killed, the file stays until the run ends, as the
router and all receivers map it. The file's name does not show its process, but its size does: the pool of
process n is n pages smaller.

Each process holds a shared lock (flock) on zenoh's files that it uses. zenoh leaves the table of a sender
(1.3 MB) behind if the router still reads it when the sender ends, and all files of killed processes.
"""

import contextlib
import fcntl
import mmap
import os
import time
from collections.abc import Iterator
from pathlib import Path

from hsslam_services.arena.shared_pages import give_back, held_bytes

_SHM = "/dev/shm/"
_SUFFIX = ".zenoh"
_NEW_S = 1.0  # a file that is younger may be without its lock yet
POOL_BYTES = 32 * 2**20


def pool_bytes(process_number: int, most: int = POOL_BYTES) -> int:
    """Size of the pool of a process, by its number from 1; 0: a process without a number."""
    return most // mmap.PAGESIZE * mmap.PAGESIZE - process_number * mmap.PAGESIZE


def bytes_of_pools(router_pid: int) -> int:
    """Memory of all pools and tables of zenoh in a run: those that its router has open."""
    files = []
    for entry, _ in _open_pools(router_pid):
        with contextlib.suppress(OSError):  # closed meanwhile
            files.append(entry.stat())
    return held_bytes(files)


def pools_of(pid: int) -> set[Path]:
    """The pools and tables that a process has open, without deleted files."""
    return {Path(path) for _, path in _open_pools(pid) if path.endswith(_SUFFIX)}


def free_pools(process_number: int, most: int = POOL_BYTES) -> int:
    """Free the pools of a dead process; returns the bytes. Call it in the router's process.

    The pools stay mapped and read as zeros, so messages in transit from the dead process are lost.
    """
    wanted = pool_bytes(process_number, most)
    freed = 0
    for entry, path in list(_open_pools(os.getpid())):
        with contextlib.suppress(OSError):
            # a file without a name was freed before; st_size is that of the open file
            if path.endswith(_SUFFIX) and entry.stat().st_size == wanted:
                give_back(int(entry.name), 0, wanted)
                freed += wanted
                Path(path).unlink()
    return freed


def remove_own_pools() -> None:
    """Remove zenoh's files that this process alone has open. Call it after its sessions are closed."""
    for entry, path in list(_open_pools(os.getpid())):
        with contextlib.suppress(OSError):  # another process uses it, or zenoh has closed it
            _remove_unused(int(entry.name), Path(path))


def remove_unused_pools() -> None:
    """Remove zenoh's files of this user that no process uses."""
    for path in Path(_SHM).glob(f"*{_SUFFIX}"):
        with contextlib.suppress(OSError):  # used, of another user, or removed meanwhile
            fd = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
            try:
                status = os.fstat(fd)
                if status.st_uid == os.getuid() and time.time() - status.st_mtime > _NEW_S:
                    _remove_unused(fd, path)
            finally:
                os.close(fd)


def _remove_unused(fd: int, path: Path) -> None:
    """Remove an open file of zenoh; BlockingIOError: another process has it locked, as it uses it."""
    fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    path.unlink()


def _open_pools(pid: int) -> Iterator[tuple[Path, str]]:
    """zenoh's files that a process has open: entry in /proc, and path; a deleted file ends in "(deleted)"."""
    with contextlib.suppress(OSError):  # the process has ended
        for entry in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):  # closed meanwhile
                path = str(entry.readlink())
                if path.startswith(_SHM) and _SUFFIX in path:
                    yield entry, path
