"""Memory that shared files really have; apart, as the budget counts files beside the arena too (no torch)."""

import mmap
import os
from collections.abc import Iterable

_BLOCK_BYTES = 512  # of st_blocks, see stat(2)


def held_bytes(files: Iterable[os.stat_result]) -> int:
    """Memory of files in a tmpfs, each counted once; holes have none."""
    return _BLOCK_BYTES * sum({(of.st_dev, of.st_ino): of.st_blocks for of in files}.values())


def give_back(fd: int, start: int, end: int) -> None:
    """Give the pages that lie within bytes `start` to `end` of a file in a tmpfs back to the system.

    All processes that map the file read zeros there from now on. Whoever writes or reads them gets new
    pages, or SIGBUS if the memory is full: reserve them first.
    """
    page = mmap.PAGESIZE
    first, last = -(-start // page) * page, end // page * page
    if first < last:
        with mmap.mmap(fd, last) as mapped:
            mapped.madvise(mmap.MADV_REMOVE, first, last - first)
