"""Where compiled kernels are cached between runs."""

import hashlib
import os
import sys
from importlib.metadata import version
from pathlib import Path

_CONSTANTS = ("kernels", "map")  # folders whose constants are compiled into the machine code


def kernel_cache_folder() -> Path:
    """Folder for NUMBA_CACHE_DIR, named by all that machine code depends on: the content and place
    of the kernel sources, numba, Python, the processor.

    numba checks only the file of the outermost kernel: after a change in a kernel that it calls, the
    stale machine code would be used. With one folder per content that cannot happen.
    """
    digest = hashlib.sha256()
    package = Path(__file__).parent.parent
    for part in (str(package), version("numba"), sys.version, processor()):
        digest.update(part.encode())
    for source in sorted(package.rglob("*.py")):
        text = source.read_text(encoding="utf-8")
        if "numba" in text or source.relative_to(package).parts[0] in _CONSTANTS:
            digest.update(text.encode())
    return cache_root() / "kernels" / digest.hexdigest()[:16]


def warm_stamp() -> Path:
    """The file that says that every kernel has been compiled into the cache."""
    return kernel_cache_folder() / "complete"


def cache_root() -> Path:
    """Folder of all that is kept between runs and can be made again."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "hsslam"


def processor() -> str:
    """Model and features of the first processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n\n")[0].splitlines()
    except OSError:
        return ""
    return "".join(line for line in lines if line.startswith(("model name", "flags", "Features")))
