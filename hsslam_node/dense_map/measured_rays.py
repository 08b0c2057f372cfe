"""Where rays come to a surface that keyframes measured, whatever the field says of it."""

import numpy as np

from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.se3 import transformed

_SHORTEST_STEP = 0.2  # in voxels
_UNKNOWN_STEP = 0.5  # in voxels, where nothing is known
# in voxels: a ray that comes so near to a surface and then to unseen space has entered it
_AT_SURFACE = 0.2
_GAP = 1.5  # in voxels: so far behind the end of free space a surface may begin


def measured_reach(
    distances: DistanceMap,
    origins: np.ndarray,
    directions: np.ndarray,
    most_m: np.ndarray,
    over_gaps: np.ndarray,
) -> np.ndarray:
    """How far rays from `origins` [R, 3] m, world, along unit `directions` [R, 3] go until they enter a
    measured surface from free space, [R] m; inf: they enter none before `most_m` [R] m. Rays `over_gaps` [R]
    enter it also over a few unseen voxels; beside an edge such a ray may end at the edge.

    Each step is as long as the distance to the nearest surface (sphere tracing).
    """
    grid, T = distances.grid, distances.T_grid_world
    box = Bound.of(grid.low, grid.high)
    near, far = box.reach(transformed(T, origins), directions @ T[:3, :3].T)
    far = np.minimum(far, most_m)
    reach, z = np.full(len(origins), np.inf), np.maximum(near, 0.0)
    # distance at the step before; nan: it was not free there
    last_m = np.full(len(origins), np.nan)
    # how far along the ray a surface is entered from the last free place
    within_m = np.full(len(origins), -np.inf)
    gap_m = np.where(over_gaps, _GAP * grid.voxel_m, 0.0)
    active = np.flatnonzero(z < far)
    while len(active):
        at = origins[active] + z[active, None] * directions[active]
        distance_m, _, known = distances.query(at.astype(np.float32))
        is_free = known & (distance_m > 0)
        is_behind = known & ~is_free
        is_at_end = last_m[active] < _AT_SURFACE * grid.voxel_m
        enters = np.where(known, is_behind & (z[active] <= within_m[active]), is_at_end)
        reach[active[enters]] = z[active[enters]]
        last_m[active] = np.where(is_free, distance_m, np.nan)
        shortest_m = np.where(known, _SHORTEST_STEP, _UNKNOWN_STEP) * grid.voxel_m
        z[active] += np.fmax(np.abs(distance_m), shortest_m)
        free = active[is_free]
        within_m[free] = z[free] + gap_m[free]
        within_m[active[is_behind]] = -np.inf
        active = active[~enters & (z[active] < far[active])]
    return reach
