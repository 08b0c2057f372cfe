"""What Triton needs beside a GPU: a C compiler, Python's headers, a folder for compiled kernels."""

import shutil
import sys
import sysconfig
from pathlib import Path

from hsslam_node.environment import COMPILER, TRITON_CACHE
from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import cache_root


def missing_tool() -> tuple[str, str] | None:
    """What Triton lacks to compile its launcher, and the packages that have it; None if it has all.

    It takes the compiler that CC names, else gcc, else clang.
    """
    packages = f"the packages gcc and python{sys.version_info[0]}.{sys.version_info[1]}-dev"
    compilers = [COMPILER.value()] if COMPILER.value() else ["gcc", "clang"]
    if not any(shutil.which(compiler) for compiler in compilers):
        return f"Triton finds no C compiler ({' or '.join(compilers)})", packages
    scheme = sysconfig.get_default_scheme()
    if scheme == "posix_local":  # of Debian; Triton includes what its Python came with
        scheme = "posix_prefix"
    headers = Path(sysconfig.get_path("include", scheme))
    if not (headers / "Python.h").exists():
        return f"Triton finds no Python.h in {headers}", packages
    return None


def keep_kernels() -> None:
    """Have Triton keep compiled kernels beside those of the CPU, unless TRITON_CACHE_DIR names a folder.

    For this process and those that it starts. Without a home folder Triton's own choice stays.
    """
    if TRITON_CACHE.value():
        return
    try:
        TRITON_CACHE.set(str(cache_root() / "triton"))
    except UserError:
        return
