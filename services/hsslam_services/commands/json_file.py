"""The file of `--json`; apart, as several commands write one."""

from pathlib import Path
from typing import Any

import msgspec

from hsslam_node.durable_file import write_durably
from hsslam_node.errors import UserError


def expect_json_file(path: Path) -> None:
    """Make the folder of a file, before long work; a pipe or a device, as /dev/stdout, is a file too.

    Raises:
        UserError: the path is a folder, or there can be no such file.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(path, error.strerror) from None
    if path.is_dir():
        raise _unwritable(path, "is a folder")


def write_json_file(path: Path, document: Any) -> None:
    """Write it with line breaks.

    Raises:
        UserError: the file cannot be written.
    """
    try:
        write_durably(path, msgspec.json.format(msgspec.json.encode(document)) + b"\n")
    except OSError as error:
        raise _unwritable(path, error.strerror) from None


def _unwritable(path: Path, why: str | None) -> UserError:
    return UserError(f"--json {path}: {why}: expected a file to write")
