"""Identifies mask and map, which options of a run name, by their content; apart, as `batch` reads neither."""

import hashlib
import os
import tomllib
from collections.abc import Iterator
from pathlib import Path

_NAMING = ("mask", "map")
_DIGEST_BYTES = 8


def named_files_digest(config: str) -> str:
    """The digest of all files that a `config.toml` names, which copies on other machines share.

    Of a folder all files count. Empty if the options name no file.

    Raises:
        OSError: a file is missing, or this user may not read it.
    """
    options = tomllib.loads(config)
    named = [Path(options[name]) for name in _NAMING if options.get(name)]
    digest = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for path, name in (pair for place in named for pair in _files(place)):
        with path.open("rb") as stream:
            content = hashlib.file_digest(stream, hashlib.blake2b)
        digest.update(os.fsencode(name) + b"\0" + content.digest())
    return digest.hexdigest() if named else ""


def _files(place: Path) -> Iterator[tuple[Path, str]]:
    """All files of a folder with their names in it, in order; else the path itself."""
    if not place.is_dir():
        yield place, ""
        return
    for path in sorted(place.rglob("*")):
        if path.is_file():
            yield path, str(path.relative_to(place))
