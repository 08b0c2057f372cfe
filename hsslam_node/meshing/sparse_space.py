"""Observed space of the live mesh: marks in blocks of a lattice; only blocks with marks take memory."""

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.kernels.compiled import njit
from hsslam_node.meshing.block_surface import Block
from hsslam_node.meshing.observed_space import (
    CLOSE_CELLS,
    CONTINUOUS,
    HALO,
    observed_cells,
    to_grid,
)

_FIRST_BLOCKS = 64
_GROWTH = 1.5
_NONE = -1
_NEWS = 24  # new marks after which a block is checked again; fewer are noise at its edges


class SparseSpace:
    """Like `ObservedSpace`, but on a lattice through the world's origin.

    A larger bound keeps all blocks. Block b covers the vertices from `block_cells * b` to
    `block_cells * (b + 1)`, both included; it stores the marks of all but the last ones.

    Args:
        voxel_m: distance of two vertices, m.
        block_cells: cells along a side of a block.
    """

    def __init__(self, voxel_m: float = 0.03, block_cells: int = 32) -> None:
        if not voxel_m > 0:
            raise UserError(f"mesh.voxel_m = {voxel_m}: expected metres above 0")
        self.voxel_m = voxel_m
        self.block_cells = block_cells
        self._low = np.zeros(3, np.int64)  # block of table[0, 0, 0]
        self._table = np.full((0, 0, 0), _NONE, np.int32)  # slot of each block of the bound
        self._news = np.zeros((0, 0, 0), np.int32)  # new marks that change its cells
        self._marks = np.zeros((_FIRST_BLOCKS, block_cells, block_cells, block_cells), np.uint8)
        self._used = np.zeros(1, np.int64)

    @property
    def block_m(self) -> float:
        """Side of a block, m."""
        return self.voxel_m * self.block_cells

    @property
    def nbytes(self) -> int:
        """Memory of the marks."""
        return self._marks.nbytes + self._table.nbytes + self._news.nbytes

    def cover(self, bound: Bound) -> None:
        """Accept marks within the bound as well; existing marks stay."""
        low = np.floor(np.divide(bound.low, self.block_m)).astype(np.int64)
        high = np.ceil(np.divide(bound.high, self.block_m)).astype(np.int64)
        if self._table.size:
            low = np.minimum(low, self._low)
            high = np.maximum(high, self._low + self._table.shape)
        shape = tuple(high - low)
        if shape == self._table.shape and (low == self._low).all():
            return
        first = self._low - low
        place = tuple(slice(a, a + n) for a, n in zip(first, self._table.shape, strict=True))
        table, news = np.full(shape, _NONE, np.int32), np.zeros(shape, np.int32)
        if self._table.size:
            table[place], news[place] = self._table, self._news
        self._low, self._table, self._news = low, table, news

    def observe(
        self, depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray, stride_px: int = 4
    ) -> None:
        """Mark the vertices nearest to every stride-th depth pixel, and to the surface between them.

        Args:
            depth_m: [H, W] float32 m, planar, 0 = no measurement.
            camera: undistorted.
            T_world_cam: [4, 4].
            stride_px: step between pixels, both ways.
        """
        T = np.array(T_world_cam, np.float64)
        T[:3] /= self.voxel_m
        T[:3, 3] -= self._low * self.block_cells
        depth = np.ascontiguousarray(depth_m, np.float32)
        intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        while _mark(
            depth, intrinsics, T, stride_px, self._marks, self._used, self._table, self._news
        ):
            self._enlarge()

    def take_grown(self) -> list[Block]:
        """Take the blocks with enough new marks since they were last taken."""
        grown = self._news >= _NEWS
        self._news[grown] = 0
        return self._indices(grown)

    def blocks(self) -> list[Block]:
        """All blocks that hold marks."""
        return self._indices(self._table >= 0)

    def cells(self, block: Block) -> np.ndarray:
        """Cells of a block whose eight vertices are near observed surface, [n, n, n] bool."""
        n = self.block_cells
        around = np.zeros((n + 1 + 2 * HALO,) * 3, np.uint8)
        for di, dj, dk in np.ndindex(3, 3, 3):
            slot = self._slot((block[0] + di - 1, block[1] + dj - 1, block[2] + dk - 1))
            if slot != _NONE:
                there, here = zip(*(_SHARE[d](n) for d in (di, dj, dk)), strict=True)
                around[there] = self._marks[slot][here]
        return observed_cells(around)

    def vertex_positions(self, block: Block, vertices: np.ndarray) -> np.ndarray:
        """World positions [N, 3] float32 m of vertices [N, 3] of a block; fractions allowed."""
        grid = np.multiply(block, self.block_cells) + vertices
        return (grid * self.voxel_m).astype(np.float32)

    def differing_blocks(self, other: "SparseSpace") -> list[Block]:
        """Blocks whose marks differ from those of the other space."""
        mine, others = self.blocks(), other.blocks()
        return [b for b in dict.fromkeys(mine + others) if not self._is_like(other, b)]

    def _is_like(self, other: "SparseSpace", block: Block) -> bool:
        mine, others = self._slot(block), other._slot(block)
        if _NONE in (mine, others):
            return mine == others
        return np.array_equal(self._marks[mine], other._marks[others])

    def _slot(self, block: Block) -> int:
        place = tuple(int(b - low) for b, low in zip(block, self._low, strict=True))
        if not all(0 <= p < n for p, n in zip(place, self._table.shape, strict=True)):
            return _NONE
        return int(self._table[place])

    def _indices(self, chosen: np.ndarray) -> list[Block]:
        return [(int(i), int(j), int(k)) for i, j, k in np.argwhere(chosen) + self._low]

    def _enlarge(self) -> None:
        n = self.block_cells
        marks = np.zeros((int(_GROWTH * len(self._marks)), n, n, n), np.uint8)
        marks[: len(self._marks)] = self._marks
        self._marks = marks


def _before(n: int) -> tuple[slice, slice]:
    return slice(0, HALO), slice(n - HALO, n)


def _within(n: int) -> tuple[slice, slice]:
    return slice(HALO, HALO + n), slice(0, n)


def _after(n: int) -> tuple[slice, slice]:
    return slice(HALO + n, n + 1 + 2 * HALO), slice(0, HALO + 1)


_SHARE = (_before, _within, _after)  # slices around a block, in its neighbour


@njit(cache=True, nogil=True, error_model="numpy")
def _mark(depth, intrinsics, T_grid_cam, stride, marks, used, table, news):
    """Mark as `ObservedSpace` does; True if there is no room for a block: call it again with more."""
    height, width = depth.shape
    fx, fy, cx, cy = intrinsics
    p = np.empty(3)
    q = np.empty(3)
    for row in range(stride // 2, height, stride):
        for column in range(stride // 2, width, stride):
            z = depth[row, column]
            if not (z > 0.0 and z < 1e4):
                continue
            to_grid(T_grid_cam, (column - cx) / fx * z, (row - cy) / fy * z, z, p)
            if _mark_vertex(p, marks, used, table, news):
                return True
            for right, down in ((stride, 0), (0, stride)):
                u, v = column + right, row + down
                if u >= width or v >= height:
                    continue
                other = depth[v, u]
                if not abs(other - z) < CONTINUOUS * z:
                    continue
                to_grid(T_grid_cam, (u - cx) / fx * other, (v - cy) / fy * other, other, q)
                steps = int(max(abs(q[0] - p[0]), abs(q[1] - p[1]), abs(q[2] - p[2])))
                for step in range(1, steps + 1):
                    share = step / (steps + 1)
                    if _mark_between(p, q, share, marks, used, table, news):
                        return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _mark_between(p, q, share, marks, used, table, news):
    between = p + share * (q - p)
    return _mark_vertex(between, marks, used, table, news)


@njit(cache=True, nogil=True, error_model="numpy")
def _mark_vertex(p, marks, used, table, news):
    """Mark the vertex nearest to a grid position; True if there is no room for its block."""
    n = marks.shape[1]
    i0 = int(np.floor(p[0] + 0.5))
    i1 = int(np.floor(p[1] + 0.5))
    i2 = int(np.floor(p[2] + 0.5))
    b0, b1, b2 = i0 // n, i1 // n, i2 // n
    if b0 < 0 or b1 < 0 or b2 < 0:
        return False
    if b0 >= table.shape[0] or b1 >= table.shape[1] or b2 >= table.shape[2]:
        return False
    slot = table[b0, b1, b2]
    if slot < 0:
        if used[0] == marks.shape[0]:
            return True
        slot = used[0]
        used[0] += 1
        table[b0, b1, b2] = slot
    if marks[slot, i0 - b0 * n, i1 - b1 * n, i2 - b2 * n]:
        return False
    marks[slot, i0 - b0 * n, i1 - b1 * n, i2 - b2 * n] = 1
    for i in range(max((i0 - HALO) // n, 0), min((i0 + CLOSE_CELLS) // n, table.shape[0] - 1) + 1):
        for j in range(
            max((i1 - HALO) // n, 0), min((i1 + CLOSE_CELLS) // n, table.shape[1] - 1) + 1
        ):
            for k in range(
                max((i2 - HALO) // n, 0), min((i2 + CLOSE_CELLS) // n, table.shape[2] - 1) + 1
            ):
                news[i, j, k] += 1
    return False
