"""What Triton needs besides a GPU: a C compiler, Python's headers, a folder for compiled kernels."""

import shutil
import sys
import sysconfig
from pathlib import Path

from hsslam_node.environment import COMPILER, TRITON_CACHE
from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import cache_root


def missing_tool() -> tuple[str, str] | None:
    """What Triton lacks to compile its launcher, and the packages that provide it, or None.

    Triton uses the compiler that CC names, else gcc, else clang.
    """
    packages = f"the packages gcc and python{sys.version_info[0]}.{sys.version_info[1]}-dev"
    compilers = [COMPILER.value()] if COMPILER.value() else ["gcc", "clang"]
    if not any(shutil.which(compiler) for compiler in compilers):
        return f"Triton finds no C compiler ({' or '.join(compilers)})", packages
    scheme = sysconfig.get_default_scheme()
    if scheme == "posix_local":  # Debian's default, which Triton replaces like this
        scheme = "posix_prefix"
    headers = Path(sysconfig.get_path("include", scheme))
    if not (headers / "Python.h").exists():
        return f"Triton finds no Python.h in {headers}", packages
    return None


def keep_kernels() -> None:
    """Set Triton's cache to a folder beside that of the CPU kernels, unless TRITON_CACHE_DIR is set.

    This holds for this process and its children. Without a home folder Triton's default stays.
    """
    if TRITON_CACHE.value():
        return
    try:
        TRITON_CACHE.set(str(cache_root() / "triton"))
    except UserError:
        return
