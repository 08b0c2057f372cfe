"""Where compiled kernels are cached between runs."""

import hashlib
import os
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path

_CONSTANTS = ("kernels", "map")  # folders whose constants are compiled into the machine code


def kernel_cache_folder() -> Path:
    """Folder for machine code, named by all that it depends on: the content and place of the kernel
    sources, numba, Python, the processor.

    numba checks only the file of the outermost kernel: after a change in a kernel that it calls, the
    stale machine code would be used. With one folder per content that cannot happen.
    """
    digest = hashlib.sha256()
    package = Path(__file__).parent.parent
    for part in (str(package), version("numba"), sys.version, processor()):
        digest.update(part.encode())
    for source in sorted(package.rglob("*.py")):
        text = source.read_text(encoding="utf-8")
        if "njit" in text or "numba" in text or source.relative_to(package).parts[0] in _CONSTANTS:
            digest.update(text.encode())
    return cache_root() / "kernels" / digest.hexdigest()[:16]


def writable_kernel_cache() -> Path:
    """The folder of `kernel_cache_folder`, made. numba uses no folder that it cannot write, not even for
    kernels that are compiled.

    Raises:
        UserError: it cannot be written.
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
    """The line on a cache that cannot be written."""
    return UserError(
        f"kernel cache {folder}: {error.strerror}: expected a folder that can be written "
        "(XDG_CACHE_HOME names another)"
    )


def warm_stamp() -> Path:
    """The file that says that every kernel has been compiled into the cache."""
    return kernel_cache_folder() / "complete"


def run_stamp() -> Path:
    """The file that says that the kernels for poses, map and mesh have been compiled into the cache."""
    return kernel_cache_folder() / "run"


def cache_root() -> Path:
    """Folder of all that is kept between runs and can be made again.

    Raises:
        UserError: this user has no home folder, and XDG_CACHE_HOME is not set.
    """
    if named := os.environ.get("XDG_CACHE_HOME"):
        return Path(named) / "hsslam"
    try:
        return user_path("~/.cache/hsslam")
    except UserError as error:
        raise UserError(f"{error}, or XDG_CACHE_HOME") from None


def processor() -> str:
    """Model and features of the first processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n\n")[0].splitlines()
    except OSError:
        return ""
    return "".join(line for line in lines if line.startswith(("model name", "flags", "Features")))
