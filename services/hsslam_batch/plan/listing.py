"""Lists the files below a folder with size and time of change, so that names alone decide what is a log."""

import contextlib
import errno
import fnmatch
import hashlib
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from hsslam_node.errors import UserError

BATCH_FILE, MANIFEST = "batch.json", "manifest.parquet"  # in the folder of every batch
_DIGEST_BYTES = 8


class ClosedError(UserError):
    """This user may not read a folder."""


@dataclass(frozen=True)
class FileStamp:
    """Size and version of a file; they differ if the content does."""

    nbytes: int
    version: str


@dataclass
class Listing:
    """Files by path below the root; the folders follow from these paths.

    `alone`: the name of the file, if the listing is that of one file; the root is then its folder.
    """

    root: str
    files: Mapping[str, FileStamp]
    alone: str = ""
    _below: dict[str, set[str]] = field(default_factory=dict)  # names in each folder

    def __post_init__(self) -> None:
        for path in self.files:
            while path:
                folder, _, name = path.rpartition("/")
                names = self._below.setdefault(folder, set())
                if name in names:
                    break
                names.add(name)
                path = folder

    def names(self, folder: str) -> list[str]:
        """Names of the files and folders in a folder, sorted; empty for a file."""
        return sorted(self._below.get(folder, ()))

    def is_folder(self, path: str) -> bool:
        """Whether there are files below the path."""
        return path in self._below

    def stamp(self, paths: Iterable[str], within: str) -> FileStamp:
        """The stamp of a log: the sum of its files' sizes, and a digest of their names, sizes and versions.

        within: path of the log, which may be one of the files; the digest has names relative to it.
        """
        digest, nbytes = hashlib.blake2b(digest_size=_DIGEST_BYTES), 0
        for path in sorted(paths):
            name, stamp = path.removeprefix(within).strip("/"), self.files[path]
            line = f"{name}\0{stamp.nbytes}\0{stamp.version}\n"
            digest.update(line.encode("utf-8", "surrogateescape"))
            nbytes += stamp.nbytes
        return FileStamp(nbytes, digest.hexdigest())

    def below(self, folder: str) -> Iterator[str]:
        """Paths of all files below a folder; for a file its own path."""
        if folder in self.files:
            yield folder
        for name in self.names(folder):
            yield from self.below(f"{folder}/{name}" if folder else name)


class ListedPath:
    """A path of a listing, with the methods of `Path` that `SourceRow.looks_like` uses."""

    def __init__(self, listing: Listing, path: str) -> None:
        self._listing = listing
        self._path = path

    def __truediv__(self, name: str) -> "ListedPath":
        return ListedPath(self._listing, f"{self._path}/{name}" if self._path else name)

    @property
    def name(self) -> str:
        return PurePosixPath(self._path).name

    @property
    def suffix(self) -> str:
        return PurePosixPath(self._path).suffix

    def exists(self) -> bool:
        return self.is_dir() or self.is_file()

    def is_dir(self) -> bool:
        return self._listing.is_folder(self._path)

    def is_file(self) -> bool:
        return self._path in self._listing.files

    def glob(self, pattern: str) -> Iterator["ListedPath"]:
        """Entries of this folder whose names match the pattern."""
        names = self._listing.names(self._path)
        return (self / name for name in names if fnmatch.fnmatchcase(name, pattern))


def list_folder(root: Path, without: str) -> Listing:
    """All files below a folder of this machine, except hidden ones and those below the folder `without`.

    Symbolic links to folders are not followed, except in the paths `root` and `without` themselves. If `root`
    is a file, the listing has that file alone. It leaves out other batches, and what this user may not see,
    each with a warning.

    Raises:
        ClosedError: this user may not read the folder.
        UserError: the folder is missing, or the file system fails.
    """
    with _folder_errors(root):
        if root.is_file():
            return Listing(str(root.parent), {root.name: _stamp(root)}, root.name)
        os.scandir(root).close()
    files = {}
    own = root / os.path.relpath(os.path.realpath(without), os.path.realpath(root))
    for folder, folders, names in os.walk(root, onerror=_leave_out):
        here = Path(folder)
        folders[:] = sorted(n for n in folders if n[0] != "." and here / n != own)
        for name in sorted(names):
            if name[0] != "." and (stamp := _stamp_of_file(here / name)):
                files[(here / name).relative_to(root).as_posix()] = stamp
    return Listing(str(root), without_batches(str(root), files))


def is_there(root: Path) -> bool:
    """Whether there is a file or folder with this name.

    Raises:
        ClosedError: this user may not read the folder in which it would be.
        UserError: the file system fails.
    """
    with _folder_errors(root):
        try:
            root.stat()  # `exists` hides errors from Python 3.14 on
        except (FileNotFoundError, NotADirectoryError):
            return False
        return True


@contextlib.contextmanager
def _folder_errors(root: Path) -> Iterator[None]:
    """Raise a UserError about a folder for each OSError in the block."""
    try:
        yield
    except OSError as error:
        kind = ClosedError if isinstance(error, PermissionError) else UserError
        raise kind(f"{root}: {error.strerror}: expected a folder with logs") from None


def without_batches(root: str, files: Mapping[str, FileStamp]) -> dict[str, FileStamp]:
    """The files that are not in the folders of batches below the root: their results are no recordings."""
    marked = (path.rpartition("/")[0] for path in files if path.endswith(f"/{BATCH_FILE}"))
    batches = [folder for folder in marked if f"{folder}/{MANIFEST}" in files]
    for folder in batches:
        _warn(f"{root}/{folder}", "the folder of a batch")
    below = tuple(f"{folder}/" for folder in batches)
    return {path: stamp for path, stamp in files.items() if not path.startswith(below)}


def _stamp_of_file(path: Path) -> FileStamp | None:
    """None for what is no file, and for a file that is gone or that this user may not see."""
    try:
        if path.is_file():
            return _stamp(path)
        if path.is_symlink() and not path.exists():
            _warn(path, f"a link to {path.readlink()}, which is not there")
        return None
    except FileNotFoundError:
        return None
    except OSError as error:
        _leave_out(error)
        return None


def _leave_out(error: OSError) -> None:
    """Warn of a file or folder that this user may not see; another error ends the plan, else it loses logs.

    Raises:
        UserError: the file system fails.
    """
    if error.errno != errno.EACCES:
        raise UserError(f"{error.filename}: {error.strerror}: expected a folder that can be read")
    _warn(error.filename, error.strerror)


def _warn(left_out: object, reason: str | None) -> None:
    print(f"warning: {left_out}: left out: {reason}", file=sys.stderr)


def _stamp(path: Path) -> FileStamp:
    status = path.stat()
    return FileStamp(status.st_size, str(status.st_mtime_ns))
