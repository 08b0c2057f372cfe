"""Named arrays in shared memory that any process of the run attaches by path."""

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
from hsslam_node.errors import OutOfMemoryError
from hsslam_services.arena.arena_view import ArrayHeader, removed_is_absent
from hsslam_services.arena.shared_pages import give_back

PARAMETERS_LEASE = "params"  # whoever steps the parameters holds it


class Arena:
    """The arrays of one arena folder; an `ArrayAllocator` (hsslam_node/map/allocator.py).

    An array is `<name>.bin`, reserved at once (a full /dev/shm is an error here, never a SIGBUS
    later) and mapped through torch's shared storage; `<name>.json` (dtype, shape) appears after
    it and makes it ready. A restarted process finds everything as it was.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)

    def create(self, name: str, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
        """A zero-filled array [*shape]; one that exists with this shape and dtype stays as it is.

        Raises:
            OutOfMemoryError: the memory is full; the bytes needed are named.
            ValueError: the array exists with another shape or dtype.
        """
        dtype = np.dtype(dtype)
        with self.lease("arena-create"):
            if not self.exists(name):
                self._reserve(name, math.prod(shape) * dtype.itemsize)
                ArrayHeader(dtype, tuple(shape)).write(self._path(name, ".json"))
        array = self.open(name)
        if array.shape != tuple(shape) or array.dtype != dtype:
            raise ValueError(
                f"array {name} is {array.dtype}{list(array.shape)}, asked for {dtype}{list(shape)}"
            )
        return array

    def open(self, name: str) -> np.ndarray:
        """The array as a writable view of the shared memory.

        Raises:
            KeyError: there is no array of this name yet.
            FileNotFoundError: it was moved to the disk, and is not there any more.
        """
        dtype, shape = ArrayHeader.read(self._path(name, ".json"))
        nbytes = math.prod(shape) * dtype.itemsize
        with removed_is_absent(self._path(name, ".json")):
            self._path(name, ".bin").stat()  # PyTorch would make the file, of zeros
        storage: Any = torch.UntypedStorage.from_file(
            str(self._path(name, ".bin")), shared=True, nbytes=max(nbytes, 1)
        )
        flat = torch.empty(0, dtype=torch.uint8).set_(storage)  # [nbytes]
        return flat.numpy()[:nbytes].view(dtype).reshape(shape)

    def exists(self, name: str) -> bool:
        """Whether an array of this name is ready."""
        return self._path(name, ".json").exists()

    def remove(self, name: str) -> None:
        """Unlink the array, if it is there; processes that map it keep its memory until they let go."""
        with self.lease("arena-create"):
            self._path(name, ".json").unlink(missing_ok=True)
            self._path(name, ".bin").unlink(missing_ok=True)

    def move_to_disk(self, name: str, folder: Path) -> None:
        """Put a file of `folder` in the place of an array that nothing writes any more.

        Whoever opens the array does not see the difference; its memory is free once those who have
        opened it before let go of it.

        Raises:
            OSError: the file cannot be written; the array is as it was.
        """
        data = self._path(name, ".bin")
        if data.is_symlink():
            return
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with durable_file(folder / data.name) as partial:
            shutil.copyfile(data, partial)
            partial.chmod(0o600)
        link = self._path(name, ".link")
        link.unlink(missing_ok=True)  # of a process that died here
        link.symlink_to((folder / data.name).absolute())
        link.replace(data)

    def drop_row(self, name: str, row: int) -> None:
        """Give the pages of `array[row]` back to the system; all processes read zeros there.

        `reserve_row` comes before the next write.
        """
        with self._row(name, row) as (fd, start, nbytes):
            give_back(fd, start, start + nbytes)

    def reserve_row(self, name: str, row: int) -> None:
        """Reserve memory for `array[row]` after `drop_row`.

        Raises:
            OutOfMemoryError: the memory is full; the bytes needed are named.
        """
        with self._row(name, row) as (fd, start, nbytes):
            self._fallocate(name, fd, start, nbytes)

    @contextlib.contextmanager
    def lease(self, name: str) -> Iterator[None]:
        """Hold the only lease of this name; the kernel frees it when its holder dies."""
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
        """The open file of an array, where `array[row]` begins in it, and how many bytes it has."""
        dtype, shape = ArrayHeader.read(self._path(name, ".json"))
        nbytes = math.prod(shape[1:]) * dtype.itemsize
        fd = os.open(self._path(name, ".bin"), os.O_RDWR)
        try:
            yield fd, row * nbytes, nbytes
        finally:
            os.close(fd)

    def _reserve(self, name: str, nbytes: int) -> None:
        path = self._path(name, ".bin")
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o600)
        try:
            self._fallocate(name, fd, 0, max(nbytes, 1))
        except (OSError, OutOfMemoryError):
            path.unlink()
            raise
        finally:
            os.close(fd)

    def _fallocate(self, name: str, fd: int, start: int, nbytes: int) -> None:
        try:
            os.posix_fallocate(fd, start, nbytes)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EFBIG, errno.ENOMEM):
                raise
            free = os.statvfs(self.folder)
            raise OutOfMemoryError(
                f"{self.folder.parent}: array {name} needs {nbytes} bytes, "
                f"{free.f_bavail * free.f_frsize} are free: expected more shared memory "
                "(docker: --shm-size)"
            ) from None
