"""zenoh's shared memory of a run: counted, and that of killed processes given back while the run goes on.

A sender's pool is a file in /dev/shm. When its process is killed, the file stays until the run ends, as the
router and all receivers keep it mapped. It has no name of its process, so its size has: each process of a
run takes a pool that is some pages smaller.
"""

import contextlib
import mmap
from pathlib import Path

from hsslam_services.arena.shared_pages import give_back, held_bytes

_SHM = "/dev/shm/"
_SUFFIX = ".zenoh"
POOL_BYTES = 32 * 2**20


def pool_bytes(process_number: int, most: int = POOL_BYTES) -> int:
    """Size of the pool of a process, numbered from 1; 0 is for all that are not told apart."""
    return most // mmap.PAGESIZE * mmap.PAGESIZE - process_number * mmap.PAGESIZE


def bytes_of_pools(router_pid: int) -> int:
    """Memory of all pools and tables of zenoh in a run: its router has those of each sender open."""
    files = []
    with contextlib.suppress(OSError):  # the router's process has ended
        for entry in Path(f"/proc/{router_pid}/fd").iterdir():
            with contextlib.suppress(OSError):  # closed meanwhile
                path = str(entry.readlink())
                if path.startswith(_SHM) and _SUFFIX in path:  # one without a name is "(deleted)"
                    files.append(entry.stat())
    return held_bytes(files)


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
                give_back(int(entry.name), 0, wanted)
                freed += wanted
                Path(path).unlink()
    return freed
