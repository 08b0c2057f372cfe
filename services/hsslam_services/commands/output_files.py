"""Files and folders that options name for results; checked before long work."""

import contextlib
import io
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import msgspec

from hsslam_node.durable_file import is_stream, write_durably
from hsslam_node.errors import UserError
from hsslam_services.run.run_info import RUN_FILE

MESH_FILE = "mesh.ply"
_MAP = "map.safetensors"


def expect_writable_folder(option: str, folder: Path) -> None:
    """Make the folder of an option.

    Raises:
        UserError: it cannot be written.
    """
    with _refused(f"{option} {folder}", "a folder that can be written"):
        folder.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=folder).close()


def expect_file(option: str, path: Path, suffixes: Sequence[str] = ()) -> None:
    """Raise UserError unless the file of an option has one of the suffixes (none: any) and can be written; a
    link is followed, and a pipe or a device, such as /dev/stdout, is not tried."""
    folder = Path(os.path.realpath(path)).parent
    if (suffixes and path.suffix.lower() not in suffixes) or path.is_dir() or not folder.is_dir():
        kind = f" {' or '.join(suffixes)}" if suffixes else ""
        raise UserError(f"{option} {path}: expected a file{kind} in a folder that exists")
    if not is_stream(path):
        with _refused(f"{option} {path}", "a file that can be written"):
            TemporaryFile(dir=folder).close()


def print_written(path: Path, what: str) -> None:
    """Print what the file of an option has, but on stderr if the file is stdout."""
    with contextlib.suppress(OSError, io.UnsupportedOperation):
        if os.path.samestat(path.stat(), os.fstat(sys.stdout.fileno())):
            print(f"{path}: {what}", file=sys.stderr)
            return
    print(f"{path}: {what}")


def is_run_folder(folder: Path) -> bool:
    """Whether the folder has the results of a run or of a merge."""
    return (folder / RUN_FILE).exists() or (folder / _MAP).exists()


def default_mesh_file() -> Path:
    """mesh.ply in the working folder, for a command without `--out`.

    Raises:
        UserError: that folder is a run's, whose own mesh.ply stays.
    """
    if is_run_folder(Path()):
        raise UserError(
            f"{Path.cwd()}: is a run folder, whose {MESH_FILE} stays: expected --out FILE"
        )
    return Path(MESH_FILE)


def expect_json_file(path: Path) -> None:
    """Make the folder of the file of `--json`; the file may be a pipe or a device, such as /dev/stdout.

    Raises:
        UserError: the path is a folder or -, or there can be no such file.
    """
    if path == Path("-"):
        raise UserError("--json -: expected a file, or /dev/stdout")
    if path.is_dir():
        raise UserError(f"--json {path}: is a folder: expected a file to write")
    if not path.exists():
        expect_writable_folder("--json", path.parent)


def write_json_file(path: Path, document: Any) -> None:
    """Write the file of `--json`, with line breaks; bytes of paths that are not UTF-8 become U+FFFD.

    Raises:
        UserError: the file cannot be written.
    """
    with _refused(f"--json {path}", "a file to write"):
        encoded = msgspec.json.encode(_in_utf8(msgspec.to_builtins(document)))
        write_durably(path, msgspec.json.format(encoded) + b"\n")


@contextlib.contextmanager
def _refused(given: str, expected: str) -> Iterator[None]:
    """Raise UserError instead of an OSError in the block: what was given, the reason, what was expected."""
    try:
        yield
    except OSError as error:
        raise UserError(f"{given}: {error.strerror}: expected {expected}") from None


def _in_utf8(value: Any) -> Any:
    match value:
        case str():
            return as_utf8(value)
        case dict():
            return {_in_utf8(key): _in_utf8(item) for key, item in value.items()}
        case list() | tuple():
            return [_in_utf8(item) for item in value]
    return value


def as_utf8(text: str) -> str:
    """The text with U+FFFD for each byte of a path that is not UTF-8."""
    return os.fsencode(text).decode(errors="replace")
