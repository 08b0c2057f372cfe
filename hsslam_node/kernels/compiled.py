"""numba's `njit` for kernels of this package; alone because every folder with kernels imports it."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from numba.core import config

from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import writable_kernel_cache


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile as `numba.njit` does, and keep machine code where `hsslam-serve warm-up` has put it.

    All programs find it there: commands, notebooks and services. NUMBA_CACHE_DIR is for other functions of a
    program that uses this package: numba alone would take stale machine code of kernels from a folder that it
    names. If no folder can be written, each program compiles anew.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        place: str = config.CACHE_DIR  # type: ignore[attr-defined]
        config.CACHE_DIR = _cache_folder() or place  # type: ignore[attr-defined]  # read right below
        try:
            return numba.njit(**options)(function)
        except RuntimeError:  # there is no folder that can be written
            options["cache"] = False
            return numba.njit(**options)(function)
        finally:
            config.CACHE_DIR = place  # type: ignore[attr-defined]

    return compiled


@cache
def _cache_folder() -> str:
    """If it cannot be written, "": numba then chooses another."""
    try:
        return str(writable_kernel_cache())
    except UserError:
        return ""
