"""The distances of a window in blocks, and those of them that have changed: what subscribers follow."""

from typing import NamedTuple

import numpy as np

from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.kernels.changed_blocks import renew_blocks, take_blocks
from hsslam_node.distance.states import BLOCK_SIDE as SIDE
from hsslam_node.distance.states import NOT_KNOWN_MM
from hsslam_node.distance.voxel_grid import VoxelGrid

_TOLERANCE_MM = 5


class Blocks(NamedTuple):
    """Cubes of SIDE voxels on the lattice of a grid."""

    places: np.ndarray  # [B, 3] int32 (x, y, z): a block begins at voxel SIDE * place
    distance_mm: np.ndarray  # [B, SIDE, SIDE, SIDE] int16 (z, y, x); NOT_KNOWN_MM


class DistanceBlocks:
    """Keeps the blocks of a window as they were last given out.

    A block is given out again once a distance in it has changed by more than 5 mm, or has become known or
    unknown. Blocks that the window leaves are forgotten. Memory is 2 bytes a voxel.
    """

    def __init__(self) -> None:
        self.grid: VoxelGrid | None = None
        self._first = np.zeros(3, np.int64)  # of the blocks, z, y, x
        self._values = np.empty((0, 0, 0), np.int16)  # mm, of all their voxels
        self._known = np.zeros((2, 3), np.int64)  # first and end of known voxels, on the lattice

    def renew(self, distances: DistanceMap) -> Blocks:
        """The blocks that have changed. All grids have voxels of one size, and one shape."""
        grid = self.grid = distances.grid
        low = np.array(grid.first[::-1])
        first = low // SIDE
        self._move_to(first, grid.shape[::-1])
        changed = np.zeros([n // SIDE for n in self._values.shape], np.uint8)
        distance_m = np.ascontiguousarray(distances.distance_m.T)
        box = self._known_blocks(low + distances.known_box())
        renew_blocks(distance_m, low - SIDE * first, box, _TOLERANCE_MM, self._values, changed)
        return self._chosen(changed != 0)

    def known(self) -> Blocks:
        """All blocks in which something is known, as they were last given out."""
        return self._chosen((self._in_blocks() != NOT_KNOWN_MM).any(axis=(3, 4, 5)))

    def _known_blocks(self, known: np.ndarray) -> np.ndarray:
        """First and end [2, 3] of the blocks that know something, before or now; `known`: voxels, now."""
        before, self._known = self._known, known
        boxes = [box for box in (before, known) if (box[0] < box[1]).all()]
        if not boxes:
            return np.zeros((2, 3), np.int64)
        low = np.min([box[0] for box in boxes], axis=0) // SIDE - self._first
        end = -(-np.max([box[1] for box in boxes], axis=0) // SIDE) - self._first
        return np.stack([low, end]).clip(0, np.floor_divide(self._values.shape, SIDE))

    def _move_to(self, first: np.ndarray, shape: tuple[int, ...]) -> None:
        """Keep what both the window of before and that of now have."""
        size = [SIDE * ((n + SIDE - 2) // SIDE + 1) for n in shape]  # wherever it begins
        if self._values.shape == tuple(size) and (first == self._first).all():
            return
        moved = np.full(size, NOT_KNOWN_MM, np.int16)
        low = SIDE * np.maximum(first, self._first)
        high = np.minimum(SIDE * first + size, SIDE * self._first + self._values.shape)
        if (low < high).all():
            here, there = (
                tuple(slice(*ends) for ends in np.stack([low, high], 1) - SIDE * begin[:, None])
                for begin in (first, self._first)
            )
            moved[here] = self._values[there]
        self._first, self._values = first, moved

    def _chosen(self, mask: np.ndarray) -> Blocks:
        """Those of a mask [Z, Y, X]; copies."""
        places = np.ascontiguousarray(np.argwhere(mask))  # of one layout, however many there are
        chosen = np.empty((len(places), SIDE, SIDE, SIDE), np.int16)
        take_blocks(self._values, places, chosen)
        return Blocks((places + self._first)[:, ::-1].astype(np.int32), chosen)

    def _in_blocks(self) -> np.ndarray:
        """A view of the values, [Z, Y, X, SIDE, SIDE, SIDE]."""
        z, y, x = (n // SIDE for n in self._values.shape)
        return self._values.reshape(z, SIDE, y, SIDE, x, SIDE).transpose(0, 2, 4, 1, 3, 5)
