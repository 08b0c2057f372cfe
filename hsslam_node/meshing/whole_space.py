"""The whole space of a bound, observed or not, in blocks; apart, as only evaluations use it."""

import numpy as np

from hsslam_node.geometry.bound import Bound
from hsslam_node.meshing.block_grid import BlockGrid
from hsslam_node.meshing.block_surface import Block


class WholeSpace(BlockGrid):
    """A `BlockSpace` in which every cell of the bound counts."""

    def __init__(self, bound: Bound, voxel_m: float, block_cells: int = 32) -> None:
        super().__init__(bound, voxel_m, block_cells)

    def blocks(self) -> list[Block]:
        """All blocks."""
        return list(np.ndindex(self.block_count))  # type: ignore[arg-type]

    def cells(self, block: Block) -> np.ndarray:
        """Cells of a block that lie in the bound, [n, n, n] bool."""
        n = self.block_cells
        room = np.clip(self.limit - np.multiply(block, n), 0, n)
        cells = np.zeros((n, n, n), np.bool_)
        cells[: room[0], : room[1], : room[2]] = True
        return cells
