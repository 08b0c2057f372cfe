"""Distances of a moment, asked at any points."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hsslam_node.distance.kernels.known_voxels import known_box
from hsslam_node.distance.states import UNKNOWN
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import transformed
from hsslam_node.kernels.compiled import njit


class Distances(NamedTuple):
    """What a map says of N points."""

    distance_m: np.ndarray  # [N] float32 to the nearest surface, negative inside; nan if not known
    gradient: np.ndarray  # [N, 3] float32 m/m, away from it; 0 if not known
    known: np.ndarray  # [N] bool: seen, free or occupied


@dataclass(frozen=True)
class DistanceMap:
    """Distance to the nearest surface, and what is free, occupied and unknown; it does not change.

    Points and gradients are in the world, which is the frame of the grid unless `T_grid_world` is given.
    """

    grid: VoxelGrid
    distance_m: np.ndarray  # [nx, ny, nz] float32 at middles of voxels; nan far from known ones
    states: np.ndarray  # [nx, ny, nz] uint8: UNKNOWN, FREE, OCCUPIED
    T_grid_world: np.ndarray = field(default_factory=lambda: np.eye(4))
    # of `known_box`, if it is known already
    box: np.ndarray | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name, kind in (("distance_m", np.float32), ("states", np.uint8)):
            array = getattr(self, name)
            if array.shape != self.grid.shape or array.dtype != kind:
                raise ValueError(f"{name} is {array.dtype}{array.shape}, not of {self.grid.shape}")
            array.flags.writeable = False

    def known_box(self) -> np.ndarray:
        """First and end (z, y, x) of the voxels that have a distance, [2, 3] int64, or a little more."""
        if self.box is not None:
            return self.box
        box = np.empty((2, 3), np.int64)
        known_box(np.ascontiguousarray(self.states.T), box)
        return box

    def query(self, points: np.ndarray) -> Distances:
        """Distances at points [N, 3] m, interpolated between the middles of eight voxels.

        Raises:
            UserError: `points` has another shape.
        """
        points = np.ascontiguousarray(points, np.float32)
        if points.ndim != 2 or points.shape[1] != 3:
            raise UserError(f"points {list(points.shape)}: expected [N, 3]")
        n = len(points)
        found = Distances(
            np.empty(n, np.float32), np.empty((n, 3), np.float32), np.empty(n, np.bool_)
        )
        T_index_world = self.grid.T_index_frame() @ self.T_grid_world
        distance, states = (np.ascontiguousarray(a.T) for a in (self.distance_m, self.states))
        _interpolate(distance, states, T_index_world[:3].copy(), points, *found)
        return found

    def is_certain(self, points: np.ndarray) -> np.ndarray:
        """Mask [N] of the points [N, 3] m, world, about which all space nearer than their distance was seen.

        The surface voxel itself may lie between. Elsewhere something unseen may be nearer, so the distance
        is but the most that it can be. The first call takes a tenth of a second for a million voxels.
        """
        found = self.query(points)
        T = self.T_grid_world
        indices = self.grid.indices(transformed(T, points))
        certain = found.known.copy()
        seen_m = self.to_unknown_m[tuple(indices[certain].T)]
        certain[certain] = seen_m > found.distance_m[certain] - self.grid.voxel_m
        return certain

    @cached_property
    def to_unknown_m(self) -> np.ndarray:
        """[nx, ny, nz] m from the middle of a voxel to that of the nearest one that was not seen."""
        # few ask for it, and it would delay the start of each run
        from scipy.ndimage import distance_transform_edt

        outside = np.pad(self.states != UNKNOWN, 1)
        inner = (slice(1, -1),) * 3
        to_unknown_m = np.asarray(distance_transform_edt(outside))[inner] * self.grid.voxel_m
        to_unknown_m.flags.writeable = False
        return to_unknown_m

    def between(self, low_m: float, high_m: float) -> "DistanceMap":
        """The layers of voxels whose middles lie from `low_m` to `high_m` along z of the grid.

        Raises:
            UserError: there are none.
        """
        grid = self.grid
        z_m = grid.centres(np.arange(grid.shape[2])[:, None] * [0, 0, 1])[:, 2]
        kept = np.flatnonzero((z_m >= low_m) & (z_m <= high_m))
        if len(kept) == 0:
            raise UserError(
                f"heights {low_m:g} to {high_m:g} m: no voxel of {grid.voxel_m:g} m has its middle between "
                f"them: expected heights that are farther apart, within {grid.low[2]:.2f} to "
                f"{grid.high[2]:.2f} m"
            )
        first = (*grid.first[:2], grid.first[2] + int(kept[0]))
        part = VoxelGrid(grid.voxel_m, first, (*grid.shape[:2], len(kept)))
        layers = slice(int(kept[0]), int(kept[-1]) + 1)
        return DistanceMap(
            part, self.distance_m[:, :, layers], self.states[:, :, layers], self.T_grid_world
        )


@njit(cache=True, nogil=True, error_model="numpy")
def _interpolate(distance, states, T_index_world, points, out, gradient, known):
    """Trilinear values; gradients are of the mean over a voxel to each side. Both grids [nz, ny, nx]."""
    nz, ny, nx = states.shape
    T = T_index_world
    g = np.empty(3, np.float32)
    for n in range(len(points)):
        p, q, r = points[n, 0], points[n, 1], points[n, 2]
        x = T[0, 0] * p + T[0, 1] * q + T[0, 2] * r + T[0, 3]
        y = T[1, 0] * p + T[1, 1] * q + T[1, 2] * r + T[1, 3]
        z = T[2, 0] * p + T[2, 1] * q + T[2, 2] * r + T[2, 3]
        i, j, k = int(np.floor(x + 0.5)), int(np.floor(y + 0.5)), int(np.floor(z + 0.5))
        is_inside = 0 <= i < nx and 0 <= j < ny and 0 <= k < nz
        known[n] = is_inside and states[k, j, i] != UNKNOWN
        if not known[n]:
            out[n] = np.nan
            gradient[n] = 0.0
            continue
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        a, b, c = np.float32(x - i), np.float32(y - j), np.float32(z - k)
        out[n] = _trilinear(distance, i, j, k, a, b, c, g)
        if 1 <= i < nx - 2 and 1 <= j < ny - 2 and 1 <= k < nz - 2:
            _smooth_gradient(distance, i, j, k, a, b, c, g)
        for axis in range(3):
            gradient[n, axis] = T[0, axis] * g[0] + T[1, axis] * g[1] + T[2, axis] * g[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _trilinear(distance, i, j, k, a, b, c, g):
    """The value at (i + a, j + b, k + c), and its derivatives into `g` [3]."""
    nz, ny, nx = distance.shape
    i0, i1 = max(i, 0), min(i + 1, nx - 1)
    j0, j1 = max(j, 0), min(j + 1, ny - 1)
    k0, k1 = max(k, 0), min(k + 1, nz - 1)
    d000, d001 = distance[k0, j0, i0], distance[k0, j0, i1]
    d010, d011 = distance[k0, j1, i0], distance[k0, j1, i1]
    d100, d101 = distance[k1, j0, i0], distance[k1, j0, i1]
    d110, d111 = distance[k1, j1, i0], distance[k1, j1, i1]
    x00, x01 = d001 - d000, d011 - d010
    x10, x11 = d101 - d100, d111 - d110
    v00, v01 = d000 + a * x00, d010 + a * x01
    v10, v11 = d100 + a * x10, d110 + a * x11
    y0, y1 = v01 - v00, v11 - v10
    w0, w1 = v00 + b * y0, v10 + b * y1
    x0, x1 = x00 + b * (x01 - x00), x10 + b * (x11 - x10)
    g[0], g[1], g[2] = x0 + c * (x1 - x0), y0 + c * (y1 - y0), w1 - w0
    return w0 + c * (w1 - w0)


@njit(cache=True, fastmath={"contract", "reassoc"}, nogil=True, error_model="numpy")
def _smooth_gradient(distance, i, j, k, a, b, c, g):
    """Derivatives of the mean over the cube of a voxel to each side; `g` stays where that is not known."""
    one = np.float32(1.0)
    g0 = g1 = g2 = np.float32(0.0)
    for dk in range(4):
        wz = one - c if dk == 0 else c if dk == 3 else one
        sz = np.float32((dk == 3) - (dk == 0))
        for dj in range(4):
            wy = one - b if dj == 0 else b if dj == 3 else one
            sy = np.float32((dj == 3) - (dj == 0))
            row = distance[k - 1 + dk, j - 1 + dj]
            f0, f1, f2, f3 = row[i - 1], row[i], row[i + 1], row[i + 2]
            mean = (one - a) * f0 + f1 + f2 + a * f3
            g0 += wy * wz * (f3 - f0)
            g1 += sy * wz * mean
            g2 += wy * sz * mean
    scale = np.float32(1.0 / 27.0)
    if not np.isnan(g0 + g1 + g2):
        g[0], g[1], g[2] = g0 * scale, g1 * scale, g2 * scale
