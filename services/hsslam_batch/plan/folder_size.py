"""Size of a folder; alone because results, logs on a scratch disk and old results are measured with it."""

import contextlib
from pathlib import Path


def folder_nbytes(folder: Path) -> int:
    """Bytes of all files in a folder, some of which may be removed or renamed meanwhile."""
    total = 0
    for path in folder.rglob("*"):
        with contextlib.suppress(FileNotFoundError):
            total += path.stat().st_size if path.is_file() else 0
    return total
