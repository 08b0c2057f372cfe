"""All of the space in a bound, seen or not, cut into blocks: for meshes that an evaluation culls."""

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.meshing.block_surface import Block


class WholeSpace:
    """A vertex grid over the bound; a `BlockSpace`, whose blocks lie as those of `ObservedSpace`.

    Args:
        bound: space to mesh.
        voxel_m: distance of two vertices, m.
        block_cells: cells along a side of a block.
    """

    def __init__(self, bound: Bound, voxel_m: float, block_cells: int = 32) -> None:
        if not voxel_m > 0:
            raise UserError(f"mesh.voxel_m = {voxel_m}: expected metres above 0")
        self.bound = bound
        self.voxel_m = voxel_m
        self.block_cells = block_cells
        self._limit = np.maximum(np.floor(bound.extent_m / voxel_m + 1e-6), 1).astype(int)  # cells
        blocks = -(-self._limit // block_cells)
        self.block_count: tuple[int, int, int] = (int(blocks[0]), int(blocks[1]), int(blocks[2]))

    def blocks(self) -> list[Block]:
        """All of them."""
        return list(np.ndindex(self.block_count))  # type: ignore[arg-type]

    def cells(self, block: Block) -> np.ndarray:
        """Cells of a block that lie in the bound, [n, n, n] bool."""
        n = self.block_cells
        room = np.clip(self._limit - np.multiply(block, n), 0, n)
        cells = np.zeros((n, n, n), np.bool_)
        cells[: room[0], : room[1], : room[2]] = True
        return cells

    def vertex_positions(self, block: Block, vertices: np.ndarray) -> np.ndarray:
        """World positions [N, 3] float32 m of vertices [N, 3] of a block; fractions allowed."""
        grid = np.multiply(block, self.block_cells) + vertices
        return (np.asarray(self.bound.low) + grid * self.voxel_m).astype(np.float32)
