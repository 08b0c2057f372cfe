"""Files that a power cut leaves whole: written under another name, synced to the disk, then renamed."""

import contextlib
import errno
import os
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

_STDOUT = Path("/dev/stdout")
_PRIVATE = 0o600
_PARTIAL = ".hsslam-"  # begin of the names of temporary files


def is_stream(path: Path) -> bool:
    """Whether the path is a pipe or a device, such as /dev/stdout: it is written in place."""
    return path == _STDOUT or (path.exists() and not path.is_file() and not path.is_dir())


@contextlib.contextmanager
def durable_file(
    path: Path | str, *, private: bool = False, suffix: str | None = None
) -> Iterator[Path]:
    """Yield a temporary path that ends in `suffix` (None: that of `path`); then its file replaces `path`.

    After the block the new content is on the disk. Before, or after a power cut during the block,
    readers find the old content. If the block raises, the temporary file is removed. A link stays, and the
    file that it names is replaced. A pipe or a device, such as /dev/stdout, gets the content at the end.
    A file that there was keeps its permissions; those of a new one follow the umask. `private`: only this
    user may read and write it.

    Raises:
        OSError: the file or its folder cannot be written.
    """
    path = Path(path)
    if "\0" in str(path):
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), repr(str(path)))
    if is_stream(path):
        with tempfile.TemporaryDirectory() as folder:
            yield (whole := Path(folder) / path.name)
            with whole.open("rb") as source, _opened(path) as stream:
                shutil.copyfileobj(source, stream)
        return
    path = Path(os.path.realpath(path))
    if not path.name or path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    suffix = path.suffix if suffix is None else suffix
    partial = path.with_name(f"{_PARTIAL}{secrets.token_hex(8)}.partial{suffix}")
    try:
        permissions = _PRIVATE if private else _permissions(partial, path)
        yield partial
        partial.chmod(permissions)  # some libraries write a private file and rename it
        sync_file(partial)
        partial.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            partial.unlink()
        if isinstance(error, OSError) and error.filename == str(partial):
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise
    sync_folder(path.parent)


def _permissions(partial: Path, path: Path) -> int:
    """Create `partial`; returns the permissions of `path`, or those of the new file if there is none."""
    with partial.open("xb") as stream:
        new = os.fstat(stream.fileno())
    try:
        return stat.S_IMODE(path.stat().st_mode)
    except FileNotFoundError:
        return stat.S_IMODE(new.st_mode)


def _opened(path: Path) -> IO[bytes]:
    """The file, open for writing; standard output goes on where it is, also if it is a file."""
    return os.fdopen(os.dup(sys.stdout.fileno()), "wb") if path == _STDOUT else path.open("wb")


def write_durably(path: Path | str, data: bytes) -> None:
    """Write `data` as the whole content of `path`, as `durable_file` does.

    The temporary file has no suffix, so no reader that takes all files of one suffix takes it.

    Raises:
        OSError: the file or its folder cannot be written.
    """
    with durable_file(path, suffix="") as partial:
        partial.write_bytes(data)


def remove_partial_files(folder: Path) -> None:
    """Remove the temporary files of `durable_file` in a folder whose writers were killed; none may live."""
    for path in folder.glob(f"{_PARTIAL}*.partial*"):
        with contextlib.suppress(OSError):
            path.unlink()


def durable_folder(folder: Path) -> None:
    """Make a folder and its parents, unless they exist; return when their names are on the disk.

    Raises:
        OSError: the folder cannot be made, or the disk refuses it.
    """
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for one in missing:
        sync_folder(one.parent)


def sync_file(path: Path) -> None:
    """Return when the content of the file is on the disk.

    Raises:
        OSError: the disk refuses it, or there is no such file.
    """
    _sync(path, os.O_RDONLY)


def sync_folder(folder: Path) -> None:
    """Return when the names in the folder are on the disk; at once if the file system cannot sync.

    Raises:
        OSError: the disk refuses it, or there is no such folder.
    """
    try:
        _sync(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some network file systems
            raise


def _sync(path: Path, flags: int) -> None:
    fd = os.open(path, flags | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
