"""The CUDA driver of this machine; alone as the installer uses it before any package is installed."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

OLDEST_DRIVER = 580  # major version that CUDA 13 needs, with which PyPI's PyTorch is built
OLDEST_CUDA = 13000

_VERSION_FILE = Path("/proc/driver/nvidia/version")  # not on WSL and Jetson


def has_cuda_driver() -> bool:
    """True if NVIDIA's driver has its control device here, or the driver's library can be loaded.

    WSL and Jetson have only the library. This does not test whether a GPU works.
    """
    if Path("/dev/nvidiactl").exists():
        return True
    try:
        _library()
    except OSError:
        return False
    return True


def driver_version(file: Path = _VERSION_FILE) -> str:
    """Version of the loaded kernel driver, such as 580.65.06; empty if unknown."""
    try:
        first, *_ = file.read_text(encoding="utf-8", errors="replace").splitlines()
    except (OSError, ValueError):
        return ""
    found = re.search(r"\d+(\.\d+)+", first)
    return found[0] if found else ""


def newest_cuda() -> int:
    """The newest CUDA that the driver's library can run, such as 12060 for 12.6; 0 if unknown."""
    version = ctypes.c_int(0)
    try:
        failed = _library().cuDriverGetVersion(ctypes.byref(version))
    except (OSError, AttributeError):
        return 0
    return 0 if failed else version.value


def _library() -> ctypes.CDLL:
    """The driver's library. Raises OSError if it cannot be loaded."""
    return ctypes.CDLL("libcuda.so.1")


def is_too_old(version: str) -> bool:
    """Whether a driver of this version is too old for PyTorch from PyPI; False if unknown."""
    return bool(version) and int(version.partition(".")[0]) < OLDEST_DRIVER
