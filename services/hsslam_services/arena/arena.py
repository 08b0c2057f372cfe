"""Named arrays in shared memory; each process of the run attaches to them by path."""

import contextlib
import errno
import fcntl
import math
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hsslam_node.durable_file import durable_file
from hsslam_node.errors import MORE_SHARED_MEMORY, OutOfMemoryError
from hsslam_services.arena.arena_view import ArrayHeader, moved_array, removed_is_absent
from hsslam_services.arena.shared_pages import give_back

PARAMETERS_LEASE = "params"  # held while a process steps the parameters


class Arena:
    """The arrays of one arena folder; an `ArrayAllocator` (hsslam_node/map/allocator.py).

    `<name>.bin` holds the data, mapped through torch's shared storage. `create` reserves all its
    pages: a full /dev/shm is an error there, and no SIGBUS later. `<name>.json` (dtype, shape) is
    written last and marks the array as ready. A restarted process finds the arrays unchanged.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)

    def create(self, name: str, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
        """Create an array [*shape] of zeros, or open the existing one of this shape and dtype.

        Raises:
            OutOfMemoryError: the memory is full; the error names the bytes needed.
            ValueError: the array exists with another shape or dtype.
        """
        dtype = np.dtype(dtype)
        with self.lease("arena-create"):
            if not self.exists(name):
                self._reserve(name, math.prod(shape) * dtype.itemsize)
                self._write_header(name, ArrayHeader(dtype, tuple(shape)))
        array = self.open(name)
        if array.shape != tuple(shape) or array.dtype != dtype:
            raise ValueError(
                f"array {name} is {array.dtype}{list(array.shape)}, expected {dtype}{list(shape)}"
            )
        return array

    def open(self, name: str) -> np.ndarray:
        """The array as a writable view of the shared memory, or a copy of one that was moved to the disk.

        Raises:
            KeyError: there is no array of this name yet.
            FileNotFoundError: it was moved to disk, and its file is gone.
            UnreadableArrayError: the disk does not give all of it.
        """
        header = ArrayHeader.read(self._path(name, ".json"))
        (dtype, shape), nbytes = header, header.nbytes
        with removed_is_absent(self._path(name, ".json")):
            if (moved := moved_array(self._path(name, ".bin"), header)) is not None:
                return moved
            self._path(name, ".bin").stat()  # PyTorch would create a missing file
        storage: Any = torch.UntypedStorage.from_file(
            str(self._path(name, ".bin")), shared=True, nbytes=max(nbytes, 1)
        )
        flat = torch.empty(0, dtype=torch.uint8).set_(storage)  # [nbytes]
        return flat.numpy()[:nbytes].view(dtype).reshape(shape)

    def exists(self, name: str) -> bool:
        """Whether an array of this name is ready."""
        return self._path(name, ".json").exists()

    def remove(self, name: str) -> None:
        """Unlink the array if it exists; its memory is free when the last process unmaps it."""
        with self.lease("arena-create"):
            self._path(name, ".json").unlink(missing_ok=True)
            self._path(name, ".bin").unlink(missing_ok=True)

    def move_to_disk(self, name: str, folder: Path) -> None:
        """Replace the data of a finished array by a link to a copy in `folder`.

        `open` then returns a copy. The shared memory is free when the processes that opened the array
        earlier unmap it.

        Raises:
            OSError: the file cannot be written; the array is unchanged.
        """
        data = self._path(name, ".bin")
        if data.is_symlink():
            return
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with durable_file(folder / data.name, private=True) as partial:
            shutil.copyfile(data, partial)
        link = self._path(name, ".link")
        link.unlink(missing_ok=True)  # left by a process that died here
        link.symlink_to((folder / data.name).absolute())
        link.replace(data)

    def drop_row(self, name: str, row: int) -> None:
        """Free the pages of `array[row]`; all processes read zeros there.

        Call `reserve_row` before the next write.
        """
        with self._row(name, row) as (fd, start, nbytes):
            give_back(fd, start, start + nbytes)

    def reserve_row(self, name: str, row: int) -> None:
        """Reserve memory for `array[row]` after `drop_row`.

        Raises:
            OutOfMemoryError: the memory is full; the error names the bytes needed.
        """
        with self._row(name, row) as (fd, start, nbytes):
            self._fallocate(name, fd, start, nbytes)

    @contextlib.contextmanager
    def lease(self, name: str) -> Iterator[None]:
        """Hold the exclusive lease of this name; the kernel frees it if the holder dies."""
        fd = os.open(self._path(name, ".lock"), os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX)
            yield
        finally:
            os.close(fd)

    def _path(self, name: str, suffix: str) -> Path:
        return self.folder / f"{name}{suffix}"

    @contextlib.contextmanager
    def _row(self, name: str, row: int) -> Iterator[tuple[int, int, int]]:
        """The open file of an array, and the first byte and the byte count of `array[row]` in it."""
        dtype, shape = ArrayHeader.read(self._path(name, ".json"))
        nbytes = math.prod(shape[1:]) * dtype.itemsize
        fd = os.open(self._path(name, ".bin"), os.O_RDWR)
        try:
            yield fd, row * nbytes, nbytes
        finally:
            os.close(fd)

    def _reserve(self, name: str, nbytes: int) -> None:
        partial = self._path(name, ".part")  # who opens an array of this name sees no shorter file
        fd = os.open(partial, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600)
        try:
            self._fallocate(name, fd, 0, max(nbytes, 1))
            partial.replace(self._path(name, ".bin"))
        except (OSError, OutOfMemoryError):
            partial.unlink(missing_ok=True)
            raise
        finally:
            os.close(fd)

    def _write_header(self, name: str, header: ArrayHeader) -> None:
        try:
            header.write(self._path(name, ".json"))
        except OSError as error:
            self._path(name, ".bin").unlink()
            raise self._refusal(name, header.nbytes, error) from None

    def _fallocate(self, name: str, fd: int, start: int, nbytes: int) -> None:
        try:
            os.posix_fallocate(fd, start, nbytes)
        except OSError as error:
            raise self._refusal(name, nbytes, error) from None

    def _refusal(self, name: str, nbytes: int, error: OSError) -> OSError | OutOfMemoryError:
        """What to raise if the memory of an array is refused by this error."""
        if error.errno == errno.EFBIG:
            return OutOfMemoryError(
                f"array {name} needs {nbytes} bytes in one file: expected a larger limit of file "
                "sizes (ulimit -f)"
            )
        if error.errno not in (errno.ENOSPC, errno.ENOMEM):
            return error
        free = os.statvfs(self.folder)
        return OutOfMemoryError(
            f"{self.folder.parent}: array {name} needs {nbytes} bytes, "
            f"{free.f_bavail * free.f_frsize} are free: {MORE_SHARED_MEMORY}"
        )
