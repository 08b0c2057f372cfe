"""The vertex grid of a mesh, in blocks; alone, as `ObservedSpace` and `WholeSpace` share it."""

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound

_MOST_CELLS = 1 << 40


class BlockGrid:
    """A vertex grid over the bound, divided into blocks.

    Vertex (0, 0, 0) lies at the low corner. Block b covers the vertices from `block_cells * b` to
    `block_cells * (b + 1)`, both included: neighbours share a layer of vertices.

    Args:
        bound: space to mesh.
        voxel_m: distance of two vertices, m.
        block_cells: cells along a side of a block.

    Raises:
        UserError: `voxel_m` is not finite and above 0, or makes more than 2^40 cells.
    """

    def __init__(self, bound: Bound, voxel_m: float, block_cells: int) -> None:
        if not (isinstance(voxel_m, int | float | np.number) and 0 < voxel_m < np.inf):
            raise UserError(f"mesh.voxel_m = {voxel_m!r}: expected metres above 0")
        if voxel_m < (least_m := least_voxel_m(bound)):
            raise UserError(
                f"mesh.voxel_m = {voxel_m}: expected at least {least_m:.2g} m in a map of this size"
            )
        self.bound = bound
        self.voxel_m = voxel_m
        self.block_cells = block_cells
        cells = np.maximum(np.floor(bound.extent_m / voxel_m + 1e-6), 1)
        self.limit = cells.astype(np.int64)  # [3], the last vertex inside the bound
        blocks = -(-self.limit // block_cells)
        self.block_count: tuple[int, int, int] = (int(blocks[0]), int(blocks[1]), int(blocks[2]))

    def vertex_positions(self, block: tuple[int, int, int], vertices: np.ndarray) -> np.ndarray:
        """World positions [N, 3] float32 m of vertices [N, 3] of a block; fractions allowed."""
        grid = np.multiply(block, self.block_cells) + vertices
        return (np.asarray(self.bound.low) + grid * self.voxel_m).astype(np.float32)


def edges_in_half_cells(vertices: np.ndarray, snap: float) -> np.ndarray:
    """Position of each mesh vertex on the grid in half cells, odd along its grid edge, [V, 3] int64.

    `vertices` [V, 3], cells. A vertex closer to a grid vertex than `snap` cells is that vertex.
    """
    nearest = np.rint(vertices)
    is_on_grid = np.abs(vertices - nearest) < snap
    return np.where(is_on_grid, 2 * nearest, 2 * np.floor(vertices) + 1).astype(np.int64)


def least_voxel_m(bound: Bound) -> float:
    """The smallest voxel size with at most 2^40 cells in a bound, m."""
    return float(np.cbrt(np.prod(bound.extent_m) / _MOST_CELLS))
