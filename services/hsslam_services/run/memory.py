"""Memory of the processes of a run (PSS): a page that n processes share counts 1/n in each."""

import contextlib
import ctypes
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import psutil

_EVERY_S = 5.0  # the kernel walks all pages for it: some milliseconds
RETURN_FREED_MEMORY_OF_RERUN = {"MIMALLOC_PURGE_DELAY": "0"}  # environment of its SDK and viewer
_LARGE_BYTES = 512 << 10
_M_MMAP_THRESHOLD = -3  # of malloc.h
_LIBC = ctypes.CDLL(None)
_TRIM = getattr(_LIBC, "malloc_trim", None)  # of glibc alone
_MALLOPT = getattr(_LIBC, "mallopt", None)


def return_large_arrays(least_bytes: int = _LARGE_BYTES) -> None:
    """Return freed arrays of `least_bytes` or more to the system from now on.

    The system clears each new array, which costs too much time for the tracker.
    """
    if _MALLOPT is not None:
        _MALLOPT(_M_MMAP_THRESHOLD, least_bytes)


def return_free_memory() -> None:
    """Return the free pages that the C library keeps to the system; takes some milliseconds."""
    if _TRIM is not None:
        _TRIM(0)


def oom_kills(vmstat: Path = Path("/proc/vmstat")) -> int:
    """How many processes the kernel has killed for lack of memory since boot; 0 if it does not say."""
    with contextlib.suppress(OSError, ValueError):
        for line in vmstat.read_text().splitlines():
            name, _, value = line.partition(" ")
            if name == "oom_kill":
                return int(value)
    return 0


class OwnMemory:
    """The PSS of a process, MB (10^6 bytes), measured every 5 s."""

    def __init__(self, pid: int | None = None) -> None:
        self._pid = pid
        self._due_s = 0.0
        self._pss_mb = 0

    def pss_mb(self) -> int:
        """The last value; 0 if the system does not report it."""
        if time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + _EVERY_S
            self._pss_mb = read_pss_mb(self._pid)
        return self._pss_mb


class MemoryOfAll:
    """Memory of all processes of a run, from measurements of the supervisor and from heartbeats."""

    def __init__(self) -> None:
        self.total_mb = 0
        self.peak_mb = 0
        self._own = OwnMemory()
        self._peaks_mb: dict[str, int] = {}
        self._fork_server: tuple[int | None, OwnMemory] = (None, OwnMemory())

    def look(self, heard_mb: Mapping[str, int], fork_server_pid: int | None) -> None:
        """Update with the values of the heartbeats; call it often."""
        if fork_server_pid != self._fork_server[0]:
            self._fork_server = fork_server_pid, OwnMemory(fork_server_pid)
        now = dict(heard_mb)
        now["supervisor"] = self._own.pss_mb()
        now["fork_server"] = self._fork_server[1].pss_mb() if fork_server_pid else 0
        self.total_mb = sum(now.values())
        self.peak_mb = max(self.peak_mb, self.total_mb)
        for name, mb in now.items():
            self._peaks_mb[name] = max(self._peaks_mb.get(name, 0), mb)

    def section(self) -> dict[str, Any]:
        """For the summary."""
        return {"memory": {"peak_pss_mb": self.peak_mb, "peak_pss_mb_of": self._peaks_mb}}


def read_pss_mb(pid: int | None = None) -> int:
    """PSS of a process (None: this one), MB; 0 if the process has ended."""
    with contextlib.suppress(psutil.Error):
        return round(psutil.Process(pid).memory_full_info().pss / 1e6)
    return 0
