"""Pages of files in shared memory; apart, as the budget counts files outside the arena too (no torch)."""

import mmap
import os
from collections.abc import Iterable

_BLOCK_BYTES = 512  # unit of st_blocks, see stat(2)


def held_bytes(files: Iterable[os.stat_result]) -> int:
    """Memory of files in a tmpfs, without holes; counts each inode once."""
    return _BLOCK_BYTES * sum({(f.st_dev, f.st_ino): f.st_blocks for f in files}.values())


def give_back(fd: int, start: int, end: int) -> None:
    """Free the whole pages between bytes `start` and `end` of a file in a tmpfs.

    All processes that map the file read zeros there. An access gets new pages, or SIGBUS if the memory is
    full: reserve them first.
    """
    page = mmap.PAGESIZE
    first, last = -(-start // page) * page, end // page * page
    if first < last:
        with mmap.mmap(fd, last) as mapped:
            mapped.madvise(mmap.MADV_REMOVE, first, last - first)
