"""Whether this machine has a CUDA driver: alone, as the installer asks before any package is there."""

import ctypes
from pathlib import Path


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
