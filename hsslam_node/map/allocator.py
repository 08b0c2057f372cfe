"""Allocators of the arrays of map and keyframes: plain memory here, the shared arena in the service."""

import math
from typing import Protocol

import numpy as np

_LINE_BYTES = 64  # of a cache line; aligned vectors of 16 floats never cross two


class UnreadableArrayError(OSError):
    """The disk does not give the data of an array. `strerror`: one line with the file and the reason."""


class ArrayAllocator(Protocol):
    """Named arrays. Creating one that exists with the same shape and type returns it as it is."""

    def create(self, name: str, shape: tuple[int, ...], dtype: np.typing.DTypeLike) -> np.ndarray:
        """Returns a new array of zeros, or the array of that name if it exists.

        Raises:
            UnreadableArrayError: it exists on a disk that does not give its data.
        """
        ...

    def open(self, name: str) -> np.ndarray:
        """An existing array; KeyError if there is none yet."""
        ...

    def exists(self, name: str) -> bool:
        """Whether the array is there."""
        ...

    def remove(self, name: str) -> None:
        """Remove the array if it exists; processes that have opened it can still use it."""
        ...

    def drop_row(self, name: str, row: int) -> None:
        """Return the memory of `array[row]`, which no process needs, to the system, if that is possible."""
        ...

    def reserve_row(self, name: str, row: int) -> None:
        """Get memory for `array[row]` again before it is written; OutOfMemoryError if there is none."""
        ...


class MemoryAllocator:
    """Arrays in this process, each at the start of a cache line, as in the arena."""

    def __init__(self) -> None:
        self._arrays: dict[str, np.ndarray] = {}

    def create(self, name: str, shape: tuple[int, ...], dtype: np.typing.DTypeLike) -> np.ndarray:
        if name not in self._arrays:
            self._arrays[name] = _zeros_at_a_line(shape, np.dtype(dtype))
        return self._arrays[name]

    def open(self, name: str) -> np.ndarray:
        return self._arrays[name]

    def exists(self, name: str) -> bool:
        return name in self._arrays

    def remove(self, name: str) -> None:
        self._arrays.pop(name, None)

    def drop_row(self, name: str, row: int) -> None:
        """The row keeps its memory: only the arena has a limit."""

    def reserve_row(self, name: str, row: int) -> None:
        """The row has its memory."""


def _zeros_at_a_line(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    nbytes = math.prod(shape) * dtype.itemsize
    raw = np.zeros(nbytes + _LINE_BYTES, np.uint8)
    start = -raw.ctypes.data % _LINE_BYTES
    return raw[start : start + nbytes].view(dtype).reshape(shape)
