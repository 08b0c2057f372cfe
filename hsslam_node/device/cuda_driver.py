"""The CUDA driver of this machine: alone, as the installer asks before any package is there."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

OLDEST_DRIVER = 580  # major version that CUDA 13 needs, with which PyPI's PyTorch is built

_VERSION_FILE = Path("/proc/driver/nvidia/version")  # not on WSL and Jetson


def has_cuda_driver() -> bool:
    """True if NVIDIA's driver has its control device here, or the driver's library can be loaded.

    The library alone is what WSL and Jetson have. Not tried: whether a GPU works.
    """
    if Path("/dev/nvidiactl").exists():
        return True
    try:
        ctypes.CDLL("libcuda.so.1")
    except OSError:
        return False
    return True


def driver_version(file: Path = _VERSION_FILE) -> str:
    """The version of the driver that the kernel has loaded, as 580.65.06; empty if it is not known."""
    try:
        first, *_ = file.read_text(encoding="utf-8", errors="replace").splitlines()
    except (OSError, ValueError):
        return ""
    found = re.search(r"\d+(\.\d+)+", first)
    return found[0] if found else ""


def is_too_old(version: str) -> bool:
    """Whether PyTorch from PyPI cannot use a driver of this version; False if it is not known."""
    return bool(version) and int(version.partition(".")[0]) < OLDEST_DRIVER
