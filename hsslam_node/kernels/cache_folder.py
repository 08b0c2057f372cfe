"""The folder that keeps compiled kernels between runs."""

import hashlib
import os
import sys
import tempfile
from functools import cache
from importlib.metadata import version
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path

_RUN, _GRID = "run", "grid"  # stamps of what the cache has
_CONSTANTS = ("kernels", "map")  # folders whose constants are compiled into the machine code


def kernel_cache_folder() -> Path:
    """Folder for machine code. Its name depends on the content and place of the kernel sources, numba,
    Python and the processor.

    numba checks only the file of the outermost kernel, so it would use stale machine code after a change in
    a kernel that this one calls. One folder per content prevents that.
    """
    return cache_root() / "kernels" / _content_name()


@cache
def _content_name() -> str:
    """The name of the folder; takes 25 ms at the first call, after which the process loads these sources."""
    digest = hashlib.sha256()
    package = Path(__file__).parent.parent
    for part in (str(package), version("numba"), sys.version, processor()):
        digest.update(part.encode())
    for source in sorted(package.rglob("*.py")):
        text = source.read_text(encoding="utf-8")
        if "njit" in text or "numba" in text or source.relative_to(package).parts[0] in _CONSTANTS:
            digest.update(text.encode())
    return digest.hexdigest()[:16]


def writable_kernel_cache() -> Path:
    """Create the folder of `kernel_cache_folder`. numba does not use a folder that is not writable, not even
    to load compiled kernels.

    Raises:
        UserError: the folder is not writable.
    """
    folder = kernel_cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path in (folder, *(path for path in folder.iterdir() if path.is_dir())):
            tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise unwritable_cache(folder, error) from None
    return folder


def unwritable_cache(folder: Path, error: OSError) -> UserError:
    """The error for a cache folder that is not writable."""
    return UserError(
        f"kernel cache {folder}: {error.strerror}: expected a writable folder "
        "(set XDG_CACHE_HOME to use another)"
    )


def warm_stamp() -> Path:
    """File that exists if the cache has every kernel."""
    return kernel_cache_folder() / "complete"


def run_stamp() -> Path:
    """File that exists if the cache has the kernels for poses, map and mesh."""
    return kernel_cache_folder() / _RUN


def grid_stamp() -> Path:
    """File that exists if the cache has the kernels for distances, which `--grid` uses."""
    return kernel_cache_folder() / _GRID


def has_run_kernels(has_grid: bool) -> bool:
    """Whether the cache has all kernels of a run that is about to start."""
    folder = kernel_cache_folder()
    return (folder / _RUN).exists() and (not has_grid or (folder / _GRID).exists())


def cache_root() -> Path:
    """Folder for files that are kept between runs and can be made again.

    Raises:
        UserError: this user has no home folder, and XDG_CACHE_HOME is not set.
    """
    if named := os.environ.get("XDG_CACHE_HOME"):
        return user_path(named).absolute() / "hsslam"
    try:
        return user_path("~/.cache/hsslam")
    except UserError as error:
        raise UserError(f"{error}, or XDG_CACHE_HOME") from None


def processor() -> str:
    """Model and features of the first processor, as far as the system reports them."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n\n")[0].splitlines()
    except OSError:
        return ""
    return "".join(line for line in lines if line.startswith(("model name", "flags", "Features")))
