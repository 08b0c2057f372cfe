"""numba's `njit` for kernels of this package; alone because every folder with kernels imports it."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from numba.core import config

from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import writable_kernel_cache


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile as `numba.njit` does, with the cache that `hsslam-serve warm-up` fills.

    Commands, notebooks and services share this cache. NUMBA_CACHE_DIR does not apply to these kernels: numba
    could load stale machine code from its folder. If no folder is writable, each program compiles again.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        place: str = config.CACHE_DIR  # type: ignore[attr-defined]
        config.CACHE_DIR = _cache_folder() or place  # type: ignore[attr-defined]  # read right below
        try:
            return numba.njit(**options)(function)
        except RuntimeError:  # no folder is writable
            options["cache"] = False
            return numba.njit(**options)(function)
        finally:
            config.CACHE_DIR = place  # type: ignore[attr-defined]

    return compiled


@cache
def _cache_folder() -> str:
    """The cache folder; "" if it is not writable: numba then chooses another."""
    try:
        return str(writable_kernel_cache())
    except UserError:
        return ""
