"""A folder in a store of fsspec; a failed request is tried again."""

import contextlib
import functools
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from hsslam_batch.plan.remote_listing import open_store
from hsslam_batch.plan.tried import tried

_AT_ONCE = 8  # files

_Answer = TypeVar("_Answer")


class Store:
    """A folder of a store; names are paths below it.

    All methods raise OSError if the store refuses a request, or fails at every try in `patience_s`.

    Raises:
        UserError: unknown kind of URL, or its package is missing.
    """

    def __init__(self, url: str, patience_s: float = 0.0) -> None:
        self.url = url.rstrip("/")
        self._patience_s = patience_s
        self._files, self._root = open_store(url)

    def read(self, name: str) -> bytes:
        """The content of a file; FileNotFoundError if there is none."""
        return self._tried(name, lambda: self._files.cat_file(self._path(name)))

    def read_all(self, names: Iterable[str]) -> dict[str, bytes]:
        """The contents of the files that exist, by name; none of them may be empty. Reads many at once."""
        left = {self._path(name): name for name in names}
        found: dict[str, bytes] = {}

        def read_left() -> None:
            paths, failure = list(left), None
            # with a range, as s3fs else asks for the size of each file first
            firsts, ends = [0] * len(left), [None] * len(left)
            answers = self._files.cat_ranges(paths, firsts, ends, on_error="return")
            for path, answer in zip(paths, answers, strict=True):
                if isinstance(answer, bytes):
                    found[left.pop(path)] = answer
                elif isinstance(answer, FileNotFoundError):
                    del left[path]
                else:
                    failure = answer
            if failure is not None:
                raise failure

        self._tried("", read_left)
        return found

    def write(self, name: str, data: bytes) -> None:
        """Write a file in one step; readers see the old content until then."""
        self._tried(name, lambda: self._files.pipe_file(self._path(name), data))

    def create(self, name: str, data: bytes) -> bool:
        """Write a file if it does not exist; returns whether it now has this content."""
        try:
            self._tried(name, lambda: self._files.pipe_file(self._path(name), data, mode="create"))
        except FileExistsError:  # perhaps ours, if the answer to an earlier try was lost
            return self.read(name) == data
        return True

    def upload(self, folder: Path, name: str) -> list[str]:
        """Upload all files of a folder of this machine below `name`; returns their paths below it, sorted.

        Raises OSError, too, if there are none, or if one of them is removed before the end.
        """
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        if not paths:
            raise OSError(f"{folder}: no files: expected a folder to upload")
        names = [path.relative_to(folder).as_posix() for path in paths]
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            list(pool.map(self._put, paths, (f"{name}/{below}" for below in names)))
        sizes = {below: path.stat().st_size for below, path in zip(names, paths, strict=True)}
        if (there := self.sizes(name)) != sizes:
            wrong = min(k for k in there.keys() | sizes.keys() if there.get(k) != sizes.get(k))
            raise OSError(f"{self.url}/{name}/{wrong}: missing or of another size after the upload")
        return names

    def sizes(self, folder: str) -> Mapping[str, int]:
        """Bytes of each file below a folder, by path below it; empty without files."""
        path = self._path(folder)

        def find() -> dict[str, Any]:
            self._files.invalidate_cache()
            return self._files.find(path, detail=True)

        found = self._tried(folder, find)
        return {name.removeprefix(f"{path}/"): int(about["size"]) for name, about in found.items()}

    def folders(self, folder: str) -> list[str]:
        """Names of the folders in a folder, in one listing of this folder alone; empty without any."""
        path = self._path(folder)

        def listed() -> list[dict[str, Any]]:
            self._files.invalidate_cache()
            with contextlib.suppress(FileNotFoundError):
                return self._files.ls(path, detail=True)
            return []

        found = self._tried(folder, listed)
        return sorted(
            one["name"].rstrip("/").rpartition("/")[2]
            for one in found
            if one["type"] == "directory"
        )

    def remove(self, names: Iterable[str]) -> None:
        """Remove files; ignores those that do not exist."""
        for name in names:
            with contextlib.suppress(FileNotFoundError):
                self._tried(name, functools.partial(self._files.rm_file, self._path(name)))

    def _put(self, path: Path, name: str) -> None:
        self._tried(name, lambda: self._files.put_file(str(path), self._path(name)))

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"

    def _tried(self, name: str, request: Callable[[], _Answer]) -> _Answer:
        return tried(f"{self.url}/{name}", request, self._patience_s)
