"""From occupied, free and unknown voxels to the distance at every known one."""

import math

import numpy as np

from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.kernels.distance_transform import (
    key_type,
    nearest_sites,
    no_site,
    padded_width,
    site_bits,
)
from hsslam_node.distance.kernels.surface_sites import (
    SITE_COLUMNS,
    mark_near_known,
    number_sites,
    signed_distances,
)
from hsslam_node.distance.occupancy import Occupancy, expect_far
from hsslam_node.errors import UserError
from hsslam_node.kernels.simd import WIDTH

FAR_M = 2.0
_MOST_FAR = 1 << 15  # voxels: 64 bits hold their square beside the number of any voxel of a grid


class DistanceMeter:
    """Measures distances again and again, in the same memory.

    Args:
        far_m: larger distances are not measured.
    """

    def __init__(self, far_m: float = FAR_M) -> None:
        expect_far(far_m)
        self._far_m = far_m
        self._keys, self._needed = np.empty(0, np.uint32), np.empty(0, np.uint16)

    def measure(self, occupancy: Occupancy) -> DistanceMap:
        """Distances of what is known now; the map stays as it is when the occupancy changes.

        Raises:
            UserError: `far_m` is more than 32768 voxels.
        """
        grid = occupancy.grid
        states, surface = occupancy.states().T, occupancy.surfaces().T
        box, count = occupancy.known_box()
        distance_m = np.empty(states.shape, np.float32)
        if (box[0] < box[1]).all():
            self._fill(states, count, surface, box, grid.voxel_m, distance_m)
        else:
            distance_m[:] = np.nan
        return DistanceMap(grid, distance_m.T, states.T, occupancy.T_grid_world, box)

    def _fill(
        self,
        states: np.ndarray,
        count: int,
        surface: np.ndarray,
        box: np.ndarray,
        voxel_m: float,
        distance_m: np.ndarray,
    ) -> None:
        """Write distances [nz, ny, nx], of a grid whose known voxels lie in a box and have `count` sites."""
        low = box[0]
        nz, ny, nx = (box[1] - low).tolist()
        if self._far_m > _MOST_FAR * voxel_m:
            raise UserError(
                f"far_m = {self._far_m}: expected {_MOST_FAR * voxel_m:g} m at most with voxels of "
                f"{voxel_m:g} m"
            )
        far = max(int(np.ceil(self._far_m / voxel_m)), 1)
        bits = site_bits(count)
        keys, needed = self._room((nz, ny, padded_width(nx)), key_type(far, bits))
        sites = np.empty((max(count, 1), SITE_COLUMNS), np.float32)
        number_sites(states, surface, low, no_site(far, bits), keys, sites)
        mark_near_known(states, low, nx, needed)
        nearest_sites(keys, needed, far, bits)
        signed_distances(keys, bits, far, states, sites, voxel_m, low, nx, distance_m)

    def _room(
        self, shape: tuple[int, int, int], kind: type[np.unsignedinteger]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Keys and marks of this shape, in the memory of earlier ones."""
        size = math.prod(shape)
        if len(self._keys) < size or self._keys.dtype != kind:
            self._keys, self._needed = np.empty(size, kind), np.empty(size // WIDTH, np.uint16)
        needed = self._needed[: size // WIDTH].reshape(*shape[:2], shape[2] // WIDTH)
        return self._keys[:size].reshape(shape), needed
