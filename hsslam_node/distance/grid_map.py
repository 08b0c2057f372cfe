"""Free, occupied and unknown cells of the floor, as `nav_msgs/OccupancyGrid` has them."""

import math
from dataclasses import dataclass

import numpy as np

from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.kernels.cells import look_down
from hsslam_node.distance.kernels.distance_transform import (
    marks,
    nearest_sites,
    no_site,
    padded_width,
)
from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.voxel_grid import layers_between
from hsslam_node.errors import UserError

CELL_UNKNOWN, CELL_FREE, CELL_OCCUPIED = -1, 0, 100
LOW_M, HIGH_M = 0.15, 1.6  # above the floor
_FREE_SHARE = 1 / 3  # of the voxels over a cell
_NO_NUMBERS = 0  # bits of the numbers of sites: only distances are asked for


@dataclass(frozen=True)
class GridMap:
    """Cells of a horizontal grid. Row 0 is the one with the least y, column 0 the one with the least x."""

    cells: np.ndarray  # [height, width] int8: -1 unknown, 0 free, 100 occupied
    resolution_m: float
    origin_m: tuple[float, float]  # corner of cell (0, 0), least x and y, in the frame of the floor
    T_floor_world: np.ndarray  # [4, 4]; the floor's frame has z up and the floor at z = 0

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or self.cells.dtype != np.int8:
            raise ValueError(f"cells are {self.cells.dtype}{self.cells.shape}, not int8 rows")
        self.cells.flags.writeable = False

    @property
    def T_floor_grid(self) -> np.ndarray:
        """From the grid's own frame, whose origin is the corner of cell (0, 0), to the floor's, [4, 4]."""
        T = np.eye(4)
        T[:2, 3] = self.origin_m
        return T

    def cells_at(self, points: np.ndarray) -> np.ndarray:
        """Values [N] int8 of the cells that hold points [N, 2] m of the floor; outside: unknown."""
        column, row = np.floor((points - self.origin_m) / self.resolution_m).astype(np.int64).T
        height, width = self.cells.shape
        inside = (row >= 0) & (column >= 0) & (row < height) & (column < width)
        values = np.full(len(points), CELL_UNKNOWN, np.int8)
        values[inside] = self.cells[row[inside], column[inside]]
        return values

    def distances_m(self, far_m: float = 2.0) -> np.ndarray:
        """Distance [height, width] float32 m from the middle of each cell to the edge of the nearest occupied
        one, so no surface in a cell is nearer; it may be up to a diagonal of a cell farther.

        0 in occupied cells, at most `far_m`, nan in unknown cells.
        """
        height, width = self.cells.shape
        # half cells: middles are odd, edges even
        occupied = np.zeros((2 * height + 1, 2 * width + 1), np.bool_)
        needed = np.zeros_like(occupied)
        rows, columns = np.nonzero(self.cells == CELL_OCCUPIED)
        for row, column in np.ndindex(3, 3):
            occupied[2 * rows + row, 2 * columns + column] = True
        known = self.cells != CELL_UNKNOWN
        needed[1::2, 1::2] = known
        far = min(math.ceil(2 * far_m / self.resolution_m), sum(occupied.shape))
        none = no_site(far, _NO_NUMBERS)
        keys = np.full((1, len(occupied), padded_width(occupied.shape[1])), none, np.uint32)
        keys[0, :, : occupied.shape[1]][occupied] = 0
        nearest_sites(keys, marks(needed[None]), far, _NO_NUMBERS)
        squared = keys[0, 1::2, 1 : 2 * width : 2]
        half_m = self.resolution_m / 2
        distance = np.minimum(np.sqrt(squared, dtype=np.float64) * half_m, far_m)
        return np.where(known, np.where(squared < none, distance, far_m), np.nan).astype(np.float32)


def grid_map(
    space: DistanceMap | Occupancy, low_m: float = LOW_M, high_m: float = HIGH_M
) -> GridMap:
    """The cells of a map, or of what is known now, whose grid has z up and the floor at z = 0.

    A cell is occupied if a voxel over it is, of the layers that begin from `low_m` to `high_m` above the
    floor; it is free if no voxel is occupied and a third or more are known to be free. The third is of all
    layers between the two heights; if one is infinite, of the grid's layers. Cells are as wide as voxels.

    Raises:
        UserError: no voxel lies between the two heights.
    """
    grid = space.grid
    states = space.states() if isinstance(space, Occupancy) else space.states
    layers = layers_between(low_m, high_m, grid.voxel_m)
    if low_m < high_m and layers[0] == layers[1]:
        raise UserError(
            f"heights {low_m:g} to {high_m:g} m: no layer of voxels of {grid.voxel_m:g} m begins between "
            "them: expected heights that are farther apart, or smaller voxels"
        )
    first, end = np.clip(np.subtract(layers, grid.first[2]), 0, grid.shape[2]).tolist()
    if not (low_m < high_m and first < end):
        raise UserError(
            f"heights {low_m} to {high_m} m: expected two that rise, within the map's "
            f"{grid.low[2]:.2f} to {grid.high[2]:.2f} m above the floor"
        )
    over = states.T[int(first) : int(end)]  # [layers, ny, nx]
    free, occupied = np.zeros(over.shape[1:], np.int32), np.zeros(over.shape[1:], np.uint8)
    look_down(np.ascontiguousarray(over), free, occupied)
    cells = np.full(free.shape, CELL_UNKNOWN, np.int8)
    asked = layers[1] - layers[0]
    cells[free >= _FREE_SHARE * (asked if np.isfinite(asked) else len(over))] = CELL_FREE
    cells[occupied != 0] = CELL_OCCUPIED
    x, y = grid.low[:2]
    return GridMap(cells, grid.voxel_m, (float(x), float(y)), space.T_grid_world)
