"""The arena as a process sees it that neither computes nor writes (no torch)."""

from pathlib import Path

import numpy as np

from hsslam_node.services.array_header import ArrayHeader


class ArenaView:
    """Read-only arrays of an arena folder; an `ArrayAllocator` that makes and removes nothing."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def create(self, name: str, shape: tuple[int, ...], dtype: np.typing.DTypeLike) -> np.ndarray:
        """The array, where its maker has made it with this shape and type.

        Raises:
            KeyError: nobody has made it yet.
            ValueError: it is another one.
        """
        array = self.open(name)
        if array.shape != tuple(shape) or array.dtype != np.dtype(dtype):
            raise ValueError(f"array {name} is {array.dtype}{list(array.shape)}")
        return array

    def open(self, name: str) -> np.ndarray:
        """The array as a read-only view of the shared memory; KeyError if there is none yet."""
        header = ArrayHeader.read(self._folder / f"{name}.json")
        return np.memmap(self._folder / f"{name}.bin", header.dtype, "r", shape=header.shape)

    def exists(self, name: str) -> bool:
        """Whether an array of this name is ready."""
        return (self._folder / f"{name}.json").exists()

    def remove(self, name: str) -> None:
        """A view removes nothing."""
        raise ValueError(f"array {name}: read-only")
