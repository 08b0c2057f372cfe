"""Identifies mask and map, which options of a run name, by size and time; apart, as `batch` reads none."""

import hashlib
import os
import tomllib
from pathlib import Path

_NAMING = ("mask", "map")
_DIGEST_BYTES = 8


def named_files_digest(config: str) -> str:
    """The digest of paths, sizes and times of change of all files that a `config.toml` names; reads none.

    Of a folder all files count. Empty if the options name no file.

    Raises:
        OSError: a file is missing, or this user may not see it.
    """
    options = tomllib.loads(config)
    named = [Path(options[name]) for name in _NAMING if options.get(name)]
    digest = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for path in named:
        for file in _files(path):
            status = file.stat()
            line = f"{file}\0{status.st_size}\0{status.st_mtime_ns}\n"
            digest.update(os.fsencode(line))
    return digest.hexdigest() if named else ""


def _files(path: Path) -> list[Path]:
    """All files of a folder; else the path itself."""
    if not path.is_dir():
        return [path]
    return sorted(file for file in path.rglob("*") if file.is_file())
