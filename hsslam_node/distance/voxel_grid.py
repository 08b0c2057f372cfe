"""A box of voxels on the lattice of its frame: where each lies, and which one holds a point."""

import math
from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound

VOXEL_M = 0.05  # of a grid of which nothing else is said
_MOST_VOXELS = 1 << 30
_ON_LATTICE = 1e-6  # voxels


class GridSizeError(UserError):
    """A grid without voxels, or of more than fit into memory."""


@dataclass(frozen=True)
class VoxelGrid:
    """Cubes of side `voxel_m`; cube (i, j, k) reaches from `voxel_m * (first + (i, j, k))` one side on.

    Two grids of one voxel size share their lattice, so a window that moves keeps its voxels. Arrays of
    values have the shape of the grid, with x fastest in memory (`np.zeros(shape, order="F")`).

    Raises:
        UserError: the voxel is not positive, the grid is empty, or it has more than 2^30 voxels.
    """

    voxel_m: float
    first: tuple[int, int, int]  # cube (0, 0, 0), counted from that at the frame's origin
    shape: tuple[int, int, int]  # cubes along x, y, z

    def __post_init__(self) -> None:
        if not (math.isfinite(self.voxel_m) and self.voxel_m > 0):
            raise UserError(f"voxel_m = {self.voxel_m}: expected metres above 0")
        if min(self.shape) < 1 or math.prod(self.shape) > _MOST_VOXELS:
            raise GridSizeError(
                f"a grid of {' x '.join(map(str, self.shape))} voxels of {self.voxel_m} m: expected 1 "
                f"to {_MOST_VOXELS} voxels"
            )

    @classmethod
    def around(
        cls, centre: np.ndarray, size_m: tuple[float, float, float], voxel_m: float
    ) -> "VoxelGrid":
        """The grid of this size, rounded to whole voxels, whose middle is nearest to a point [3] m."""
        _expect_voxel(voxel_m)
        shape = np.maximum(np.rint(np.divide(size_m, voxel_m)), 1).astype(np.int64)
        first = np.rint(np.divide(centre, voxel_m) - shape / 2).astype(np.int64)
        return cls(voxel_m, _triple(first), _triple(shape))

    @classmethod
    def over(cls, bound: Bound, voxel_m: float) -> "VoxelGrid":
        """The smallest grid that covers a box."""
        _expect_voxel(voxel_m)
        first = np.floor(np.divide(bound.low, voxel_m) + 1e-9).astype(np.int64)
        last = np.ceil(np.divide(bound.high, voxel_m) - 1e-9).astype(np.int64)
        return cls(voxel_m, _triple(first), _triple(np.maximum(last - first, 1)))

    @property
    def low(self) -> np.ndarray:
        """The corner of the box with the smallest coordinates, [3] m."""
        return np.multiply(self.first, self.voxel_m)

    @property
    def high(self) -> np.ndarray:
        """The corner opposite, [3] m."""
        return np.add(self.first, self.shape) * self.voxel_m

    @property
    def count(self) -> int:
        """Number of voxels."""
        return math.prod(self.shape)

    def centres(self, indices: np.ndarray) -> np.ndarray:
        """Middles [N, 3] m of the voxels of indices [N, 3]; fractions allowed."""
        return (np.asarray(indices) + np.asarray(self.first) + 0.5) * self.voxel_m

    def indices(self, points: np.ndarray) -> np.ndarray:
        """Indices [N, 3] int64 of the voxels that hold points [N, 3] m; they may lie outside."""
        return np.floor(np.divide(points, self.voxel_m)).astype(np.int64) - self.first

    def holds(self, indices: np.ndarray) -> np.ndarray:
        """Mask [N] of the indices [N, 3] that are of this grid."""
        return np.asarray(((indices >= 0) & (indices < self.shape)).all(axis=-1))

    def moved(self, steps: np.ndarray) -> "VoxelGrid":
        """The grid of the same shape, `steps` [3] voxels on."""
        return VoxelGrid(self.voxel_m, _triple(np.add(self.first, steps)), self.shape)

    def within(self, other: "VoxelGrid") -> tuple[slice, slice, slice]:
        """Where arrays of another grid of this lattice, which covers this one, have the voxels of this one.

        Raises:
            ValueError: it does not cover it.
        """
        begin = np.subtract(self.first, other.first)
        end = begin + self.shape
        if self.voxel_m != other.voxel_m or (begin < 0).any() or (end > other.shape).any():
            raise ValueError(f"{other} does not cover {self}")
        x, y, z = (slice(int(a), int(b)) for a, b in zip(begin, end, strict=True))
        return x, y, z

    def T_index_frame(self) -> np.ndarray:
        """Maps points, m, to fractional indices, [4, 4]: the middle of voxel (0, 0, 0) is at 0, 0, 0."""
        T = np.diag([1 / self.voxel_m] * 3 + [1.0])
        T[:3, 3] = -np.asarray(self.first) - 0.5
        return T


def layers_between(low_m: float, high_m: float, voxel_m: float) -> tuple[float, float]:
    """First and end of the layers of voxels that begin between two heights, the lower one included.

    They are counted along z from the one that begins at z = 0; a height of inf has the layer inf.
    """
    first, end = np.ceil(np.divide([low_m, high_m], voxel_m) - _ON_LATTICE).tolist()
    return first, end


def _expect_voxel(voxel_m: float) -> None:
    if not (math.isfinite(voxel_m) and voxel_m > 0):
        raise UserError(f"voxel_m = {voxel_m}: expected metres above 0")


def _triple(numbers: np.ndarray) -> tuple[int, int, int]:
    x, y, z = (int(n) for n in numbers)
    return x, y, z
