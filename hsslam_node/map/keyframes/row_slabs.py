"""The arrays of the rows of keyframes, in slabs that are made as the rows come."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hsslam_node.map.allocator import ArrayAllocator

SLAB_ROWS = 4096  # 3.0 MB, with gaps 4.2 MB
BLOCK_ROWS = 128  # rows that lose their memory together: whole pages of each array
COLUMNS = 10
_BLOCKS = SLAB_ROWS // BLOCK_ROWS  # in a slab


class RowSlab(NamedTuple):
    """Arrays of `SLAB_ROWS` rows."""

    meta: np.ndarray  # [SLAB_ROWS, COLUMNS] int64
    poses: np.ndarray  # [2, SLAB_ROWS, 4, 4] T_world_cam of both banks
    covariances: np.ndarray  # [SLAB_ROWS, 6, 6] of the pose
    # [SLAB_ROWS, 4, 4] T_world_cam at which the mapper last saw the keyframe; 0: never
    mapped: np.ndarray


class RowSlabs:
    """Slabs by number. Each process has its own views of them; threads may open one at once."""

    def __init__(self, arrays: ArrayAllocator) -> None:
        self._arrays = arrays
        self._slabs: dict[int, RowSlab] = {}
        self._others: dict[str, np.ndarray] = {}  # arrays that only some slabs have, by name

    def slab(self, number: int, create: bool = False) -> RowSlab:
        """A slab; OutOfMemoryError if there is no room to create it."""
        slab = self._slabs.get(number)
        if slab is None:
            names = _names(number)
            if create:  # blocks are rows of the arrays, so that their memory can be dropped
                slab = RowSlab(
                    self._arrays.create(names.meta, (SLAB_ROWS, COLUMNS), np.int64),
                    self._arrays.create(names.poses, (2 * _BLOCKS, BLOCK_ROWS, 4, 4), np.float64),
                    self._arrays.create(names.covariances, (_BLOCKS, BLOCK_ROWS, 6, 6), np.float64),
                    self._arrays.create(names.mapped, (_BLOCKS, BLOCK_ROWS, 4, 4), np.float64),
                )
            else:
                slab = RowSlab(*map(self._arrays.open, names))
            slab = RowSlab(
                slab.meta,
                slab.poses.reshape(2, SLAB_ROWS, 4, 4),
                slab.covariances.reshape(SLAB_ROWS, 6, 6),
                slab.mapped.reshape(SLAB_ROWS, 4, 4),
            )
            self._slabs[number] = slab
        return slab

    def gaps(self, number: int, create: bool = False) -> np.ndarray:
        """[SLAB_ROWS, 6, 6]: covariances of motions by odometry alone, if a row of the slab has one."""
        return self._other(f"keyframe_gaps.{number:03d}", (6, 6), np.float64, create)

    def relative(self, number: int, create: bool = False) -> np.ndarray:
        """[SLAB_ROWS, 3, 4] float32: T_anchor_keyframe of settled rows, if the slab has any.

        An anchor is a few metres away at most, so the error is below 1 um.
        """
        return self._other(f"keyframe_settled.{number:03d}", (3, 4), np.float32, create)

    def of(self, ids: np.ndarray) -> Iterator[tuple[RowSlab, np.ndarray, np.ndarray]]:
        """Each slab that has keyframes of `ids` [n], the places [m] of these in `ids`, and their rows [m]."""
        number = ids // SLAB_ROWS
        order = np.argsort(number, kind="stable")
        for mine in np.split(order, np.flatnonzero(np.diff(number[order])) + 1):
            if len(mine):
                yield self.slab(int(number[mine[0]])), mine, ids[mine] % SLAB_ROWS

    def drop_block(self, block: int) -> None:
        """Return the memory of poses, covariances and what the mapper noted of a block to the system."""
        number, row = divmod(block, _BLOCKS)
        names = _names(number)
        for bank in range(2):
            self._arrays.drop_row(names.poses, bank * _BLOCKS + row)
        self._arrays.drop_row(names.covariances, row)
        self._arrays.drop_row(names.mapped, row)

    def _other(
        self, name: str, shape: tuple[int, ...], dtype: np.typing.DTypeLike, create: bool
    ) -> np.ndarray:
        array = self._others.get(name)
        if array is None:
            if create:
                array = self._arrays.create(name, (SLAB_ROWS, *shape), dtype)
            else:
                array = self._arrays.open(name)
            self._others[name] = array
        return array


class _Names(NamedTuple):
    meta: str
    poses: str
    covariances: str
    mapped: str


def _names(number: int) -> _Names:
    return _Names(*(f"keyframe_{kind}.{number:03d}" for kind in RowSlab._fields))
