"""Who provides the arrays of map and keyframes: plain memory here, the shared arena in the service."""

from typing import Protocol

import numpy as np


class ArrayAllocator(Protocol):
    """Named arrays. Creating one that exists with the same shape and type returns it as it is."""

    def create(self, name: str, shape: tuple[int, ...], dtype: np.typing.DTypeLike) -> np.ndarray:
        """A new array of zeros, or the existing one of that name."""
        ...

    def open(self, name: str) -> np.ndarray:
        """An existing array; KeyError if there is none yet."""
        ...

    def exists(self, name: str) -> bool:
        """Whether the array is there."""
        ...


class MemoryAllocator:
    """Arrays in this process."""

    def __init__(self) -> None:
        self._arrays: dict[str, np.ndarray] = {}

    def create(self, name: str, shape: tuple[int, ...], dtype: np.typing.DTypeLike) -> np.ndarray:
        if name not in self._arrays:
            self._arrays[name] = np.zeros(shape, dtype)
        return self._arrays[name]

    def open(self, name: str) -> np.ndarray:
        return self._arrays[name]

    def exists(self, name: str) -> bool:
        return name in self._arrays
