"""The observed space around surfaces."""

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.kernels.compiled import njit
from hsslam_node.meshing.block_grid import BlockGrid

CLOSE_CELLS = 2  # marks grow by this many cells, then shrink by one: gaps close, no second skin
CONTINUOUS = 0.04  # neighbouring pixels whose depth differs by a smaller share lie on one surface
HALO = CLOSE_CELLS + 1


class ObservedSpace(BlockGrid):
    """A `BlockGrid` that remembers where depth was measured.

    Raises:
        OutOfMemoryError: memory does not suffice for such small voxels.
    """

    def __init__(self, bound: Bound, voxel_m: float = 0.03, block_cells: int = 32) -> None:
        super().__init__(bound, voxel_m, block_cells)
        # A halo on each side avoids border cases. Only marked pages take memory.
        vertices = np.multiply(self.block_count, block_cells) + 1
        try:
            self._surface = np.zeros(vertices + 2 * HALO, np.uint8)
        except MemoryError as error:
            raise OutOfMemoryError(
                f"mesh.voxel_m = {voxel_m}: {error}: expected a larger voxel"
            ) from None
        self._occupied = np.zeros(self.block_count, np.bool_)

    def observe(
        self, depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray, stride_px: int = 2
    ) -> None:
        """Mark the vertices nearest to every stride-th depth pixel, and their blocks.

        It also marks the lines between neighbouring pixels on one surface, as pixels of a floor at a grazing
        angle lie many voxels apart. Several threads may call it in parallel.

        Args:
            depth_m: [H, W] float32 m, planar, 0 = no measurement.
            camera: undistorted.
            T_world_cam: [4, 4].
            stride_px: step between pixels, both ways.
        """
        T = np.array(T_world_cam, np.float64)
        T[:3, 3] -= self.bound.low
        T[:3] /= self.voxel_m
        intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        _mark(
            np.ascontiguousarray(depth_m, np.float32),
            intrinsics,
            T,
            stride_px,
            self._surface,
            self.limit,
            self._occupied,
            self.block_cells,
        )

    def occupied_blocks(self) -> list[tuple[int, int, int]]:
        """All blocks whose cells depend on a marked vertex."""
        return [(int(i), int(j), int(k)) for i, j, k in np.argwhere(self._occupied)]

    def cells(self, block: tuple[int, int, int]) -> np.ndarray:
        """Cells of a block whose eight vertices are near observed surface, [n, n, n] bool."""
        cells = observed_cells(np.ascontiguousarray(self._surface[self._slices(block)]))
        for axis in range(3):  # no cell beyond the bound
            room = max(int(self.limit[axis]) - block[axis] * self.block_cells, 0)
            cells[(slice(None),) * axis + (slice(room, None),)] = False
        return cells

    def _slices(self, block: tuple[int, int, int]) -> tuple[slice, slice, slice]:
        """The vertices of a block with the halo around them."""
        n = self.block_cells
        i, j, k = (slice(n * b, n * (b + 1) + 1 + 2 * HALO) for b in block)
        return i, j, k


@njit(cache=True, nogil=True, error_model="numpy")
def _mark(depth, intrinsics, T_grid_cam, stride, surface, limit, occupied, block_cells):
    """Mark the vertices nearest to back-projected pixels and to the surface between neighbours."""
    height, width = depth.shape
    across = (np.arange(width) - intrinsics[2]) / intrinsics[0]
    grid = np.empty((2, 3, width))  # positions of the pixels of a row and of the next
    for row in range(stride // 2, height, stride):
        here, below = row // stride % 2, (row // stride + 1) % 2
        if row == stride // 2:
            _grid_row(depth, row, across, intrinsics, T_grid_cam, stride, grid[here])
        if row + stride < height:
            _grid_row(depth, row + stride, across, intrinsics, T_grid_cam, stride, grid[below])
        for column in range(stride // 2, width, stride):
            z = depth[row, column]
            if not (z > 0.0 and z < 1e4):
                continue
            x0, x1, x2 = grid[here, 0, column], grid[here, 1, column], grid[here, 2, column]
            _mark_vertex(x0, x1, x2, surface, limit, occupied, block_cells)
            for line, u, v in ((here, column + stride, row), (below, column, row + stride)):
                if u >= width or v >= height or not abs(depth[v, u] - z) < CONTINUOUS * z:
                    continue
                d0, d1, d2 = grid[line, 0, u] - x0, grid[line, 1, u] - x1, grid[line, 2, u] - x2
                steps = int(max(abs(d0), abs(d1), abs(d2)))
                for step in range(1, steps + 1):
                    share = step / (steps + 1)
                    y0, y1, y2 = x0 + share * d0, x1 + share * d1, x2 + share * d2
                    _mark_vertex(y0, y1, y2, surface, limit, occupied, block_cells)


@njit(cache=True, nogil=True, error_model="numpy")
def _grid_row(depth, row, across, intrinsics, T, stride, out):
    """Write the grid positions of every stride-th pixel of a row into `out` [3, W]."""
    down = (row - intrinsics[3]) / intrinsics[1]
    for a in range(3):
        for column in range(stride // 2, len(across), stride):
            z = depth[row, column]
            position = T[a, 0] * (across[column] * z) + T[a, 1] * (down * z) + T[a, 2] * z
            out[a, column] = position + T[a, 3]


@njit(cache=True, nogil=True, error_model="numpy")
def to_grid(T_grid_cam, x, y, z, out):
    """Write the grid position of camera point (x, y, z), m, into `out` [3]."""
    for a in range(3):
        out[a] = T_grid_cam[a, 0] * x + T_grid_cam[a, 1] * y + T_grid_cam[a, 2] * z
        out[a] += T_grid_cam[a, 3]


@njit(cache=True, nogil=True, error_model="numpy")
def _mark_vertex(x, y, z, surface, limit, occupied, block_cells):
    """Mark the vertex nearest to a grid position and the blocks whose cells it changes."""
    i0 = int(np.floor(x + 0.5))
    i1 = int(np.floor(y + 0.5))
    i2 = int(np.floor(z + 0.5))
    if i0 < 0 or i1 < 0 or i2 < 0 or i0 > limit[0] or i1 > limit[1] or i2 > limit[2]:
        return
    if surface[i0 + HALO, i1 + HALO, i2 + HALO]:
        return
    surface[i0 + HALO, i1 + HALO, i2 + HALO] = 1
    for i in range(
        max((i0 - HALO) // block_cells, 0),
        min((i0 + CLOSE_CELLS) // block_cells, occupied.shape[0] - 1) + 1,
    ):
        for j in range(
            max((i1 - HALO) // block_cells, 0),
            min((i1 + CLOSE_CELLS) // block_cells, occupied.shape[1] - 1) + 1,
        ):
            for k in range(
                max((i2 - HALO) // block_cells, 0),
                min((i2 + CLOSE_CELLS) // block_cells, occupied.shape[2] - 1) + 1,
            ):
                occupied[i, j, k] = True


def _window(grid: np.ndarray, width: int, combine: np.ufunc) -> np.ndarray:
    """The marks in a cube of `width` combined; every axis shrinks by width - 1."""
    for axis in range(3):
        along = np.moveaxis(grid, axis, 0)
        n = len(along) - width + 1
        out = along[:n].copy()
        for step in range(1, width):
            combine(out, along[step : step + n], out=out)
        grid = np.moveaxis(out, 0, axis)
    return np.ascontiguousarray(grid)


def observed_cells(surface: np.ndarray) -> np.ndarray:
    """Cells of a block from the marks of its vertices and the halo around them."""
    grown = _window(surface, 2 * CLOSE_CELLS + 1, np.bitwise_or)  # one vertex of halo is left
    vertices = _window(grown, 3, np.bitwise_and)  # [n + 1] vertices
    return _window(vertices, 2, np.bitwise_and).view(np.bool_)
