"""zenoh's shared memory of processes that were killed, given back while the run goes on.

A sender's pool is a file in /dev/shm. When its process is killed, the file stays until the run ends, as the
router and all receivers keep it mapped. It has no name of its process, so its size has: each process of a
run takes a pool that is some pages smaller.
"""

import contextlib
import ctypes
import mmap
from pathlib import Path

_SHM = "/dev/shm/"
_SUFFIX = ".zenoh"
_PUNCH_HOLE = 3  # fallocate(2): KEEP_SIZE and PUNCH_HOLE
POOL_BYTES = 32 * 2**20


def pool_bytes(process_number: int, most: int = POOL_BYTES) -> int:
    """Size of the pool of a process, numbered from 1; 0 is for all that are not told apart."""
    return most // mmap.PAGESIZE * mmap.PAGESIZE - process_number * mmap.PAGESIZE


def free_pools(process_number: int, most: int = POOL_BYTES) -> int:
    """In the router's process: free the pools of a process that is dead; returns the bytes.

    They stay mapped, empty. What is still on its way from the dead process cannot be read any more.
    """
    wanted = pool_bytes(process_number, most)
    freed = 0
    for entry in list(Path("/proc/self/fd").iterdir()):
        with contextlib.suppress(OSError):
            path = str(entry.readlink())
            if not path.startswith(_SHM) or not path.endswith(_SUFFIX):
                continue  # another file, or one that is freed already
            if entry.stat().st_size == wanted:  # of the open file, not of its name
                freed += _free(int(entry.name), wanted)
                Path(path).unlink()
    return freed


def _free(fd: int, nbytes: int) -> int:
    fallocate = ctypes.CDLL(None, use_errno=True).fallocate
    fallocate.argtypes = ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64
    if fallocate(fd, _PUNCH_HOLE, 0, nbytes):
        raise OSError(ctypes.get_errno(), "fallocate")
    return nbytes
