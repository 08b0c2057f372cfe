"""Read-only access to an arena without torch: array headers `<name>.json` and views.

Separate from `arena.py` so that the supervisor does not import torch.
"""

import contextlib
import errno
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hsslam_node.map.allocator import UnreadableArrayError


class ArrayHeader(NamedTuple):
    """Type and shape of an array."""

    dtype: np.dtype
    shape: tuple[int, ...]

    @property
    def nbytes(self) -> int:
        """Memory of the array."""
        return math.prod(self.shape) * self.dtype.itemsize

    def write(self, path: Path) -> None:
        """Write the header atomically."""
        descr = np.lib.format.dtype_to_descr(self.dtype)
        partial = path.with_suffix(".tmp")
        try:
            partial.write_text(json.dumps({"dtype": descr, "shape": list(self.shape)}))
            partial.replace(path)
        except OSError:
            partial.unlink(missing_ok=True)
            raise

    @staticmethod
    def read(path: Path) -> "ArrayHeader":
        """Read the header from a file; raises KeyError with the array's name if there is no file."""
        try:
            header = json.loads(path.read_text())
        except FileNotFoundError:
            raise KeyError(path.stem) from None
        return ArrayHeader(_dtype(header["dtype"]), tuple(header["shape"]))


@contextlib.contextmanager
def removed_is_absent(header: Path) -> Iterator[None]:
    """Raise KeyError instead of FileNotFoundError if the array with this header file was removed."""
    try:
        yield
    except FileNotFoundError:
        if header.exists():
            raise
        raise KeyError(header.stem) from None


def moved_array(data: Path, header: ArrayHeader) -> np.ndarray | None:
    """A copy of the array if its data was moved to the disk, else None.

    It is read and not mapped: a bad sector or a cut file would kill a process that maps it (SIGBUS), and a
    disk that hangs would stop all its threads.

    Raises:
        UnreadableArrayError: the disk does not give all of it.
        FileNotFoundError: the file on the disk is gone.
    """
    if not data.is_symlink():
        return None
    content = np.zeros(header.nbytes, np.uint8)
    try:
        with data.open("rb") as file:
            count = file.readinto(content.data)
    except FileNotFoundError:
        raise
    except OSError as error:
        why = str(error.strerror)
    else:
        why = "" if count == header.nbytes else f"{count} bytes: expected {header.nbytes}"
    if why:
        raise UnreadableArrayError(errno.EIO, f"{data.readlink()}: {why}")
    return content.view(header.dtype).reshape(header.shape)


def _dtype(descr: Any) -> np.dtype:
    """The dtype of a descriptor in JSON, which has lists in place of tuples."""
    if isinstance(descr, str):
        return np.dtype(descr)
    fields: Any = [
        (field[0], _dtype(field[1]).descr if isinstance(field[1], list) else field[1])
        + ((tuple(field[2]),) if len(field) > 2 else ())
        for field in descr
    ]
    return np.lib.format.descr_to_dtype(fields)


class ArenaView:
    """Read-only arrays of an arena folder; an `ArrayAllocator` that can only open arrays."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def create(self, name: str, shape: tuple[int, ...], dtype: np.typing.DTypeLike) -> np.ndarray:
        """Open the existing array of this shape and dtype.

        Raises:
            KeyError: the array does not exist yet.
            ValueError: the array has another shape or dtype.
        """
        array = self.open(name)
        if array.shape != tuple(shape) or array.dtype != np.dtype(dtype):
            raise ValueError(f"array {name} is {array.dtype}{list(array.shape)}")
        return array

    def open(self, name: str) -> np.ndarray:
        """The array as a read-only view of the shared memory, or a copy of one that was moved to the disk.

        Raises:
            KeyError: the array does not exist yet.
            UnreadableArrayError: the disk does not give all of it.
        """
        path = self._folder / f"{name}.json"
        data, header = path.with_suffix(".bin"), ArrayHeader.read(path)
        with removed_is_absent(path):
            moved = moved_array(data, header)
            return (
                np.memmap(data, header.dtype, "r", shape=header.shape) if moved is None else moved
            )

    def exists(self, name: str) -> bool:
        """Whether an array of this name is ready."""
        return (self._folder / f"{name}.json").exists()

    def remove(self, name: str) -> None:
        """Not allowed: raises ValueError."""
        raise ValueError(f"array {name}: read-only")

    def drop_row(self, name: str, row: int) -> None:
        """Not allowed: raises ValueError."""
        raise ValueError(f"array {name}: read-only")

    def reserve_row(self, name: str, row: int) -> None:
        """Not allowed: raises ValueError."""
        raise ValueError(f"array {name}: read-only")
