"""What keyframes saw: how well each cell of space is known, and how far it is to the nearest surface."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from hsslam_node.dense_map.keyframes import MapKeyframes
from hsslam_node.dense_map.seen_information import add_information
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.occupancy import FAR_M, Occupancy, expect_far
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.view_distance import surface_shift_m
from hsslam_node.presets import REALTIME

_MARGIN_M = 0.5  # around seen space, so that a growing map seldom needs another grid
_EXTENT_PX = 8  # step between the pixels that bound what a keyframe sees
GONE_M = 0.05  # where keyframes saw free space, the field has no surface that is farther from measured ones
PRIOR_INFORMATION = np.float32(0.01**-2)  # 1/m^2, of a place known to 1 cm, for the certainty


class SeenCells(NamedTuple):
    """What keyframes saw of the cells of a grid.

    `information` [X, Y, Z] float32 1/m^2, x fastest, sums 1 / deviation^2 over the keyframes that saw a
    cell, with the deviation of a depth measured there; 0: no keyframe saw it.
    `distances`: to the surfaces that keyframes measured and did not see through later, of the same grid.
    """

    grid: VoxelGrid
    information: np.ndarray
    distances: DistanceMap

    def saw(self, points: np.ndarray) -> np.ndarray:
        """Mask [N] of the points [N, 3] m that a keyframe saw, just behind its surface too."""
        indices = self.grid.indices(points)
        seen = self.grid.holds(indices)
        seen[seen] = self.information[tuple(indices[seen].T)] > 0
        return seen

    def may_have_surface(self, points: np.ndarray) -> np.ndarray:
        """Mask [N] of the points [N, 3] m that a keyframe saw, and that are not free space by later ones."""
        return self.saw(points) & self.is_not_gone(points)

    def is_not_gone(self, points: np.ndarray) -> np.ndarray:
        """Mask [N] of the points [N, 3] m that are not free space by later keyframes.

        The field keeps the surface of an object that was carried off.
        """
        found = self.distances.query(points)
        return ~(found.known & (found.distance_m > GONE_M))


def certainty_of(information: np.ndarray) -> np.ndarray:
    """Certainty of a place, 0 (no keyframe saw it) to 1, from its information, 1/m^2.

    It is the share that measuring removes of a prior variance of (1 cm)^2. One look from 1, 2 and 4 m
    gives 0.97, 0.66 and 0.11; ten looks give 1.00, 0.95 and 0.55.
    """
    return information / (information + PRIOR_INFORMATION)


class SeenSpace:
    """Follows keyframes: marks the cells in front of the depth that they measured, and at it.

    Threads may call it at once.

    Args:
        reach_m: how far behind a surface still counts as seen, m.
        cell_m: side of a cell, m.
        max_depth_m: farther depth counts as none, as in the mapping.
        far_m: farther depth gives certainty and free space up to here, but no surface.
        within: only cells in this box are kept; its corners are corners of cells.
        expect_room: called with the number of cells before memory for them is taken; may raise.

    Raises:
        UserError: `far_m` is not above 0.
    """

    def __init__(
        self,
        reach_m: float,
        cell_m: float = 0.05,
        max_depth_m: float = REALTIME.mapper.max_depth_m,
        far_m: float = FAR_M,
        within: Bound | None = None,
        expect_room: Callable[[int], None] | None = None,
    ) -> None:
        expect_far(far_m)
        self._reach_m = reach_m
        self._far_m = far_m
        self._cell_m = cell_m
        self._max_depth_m = max_depth_m
        self._within, self._expect_room = within, expect_room
        self._marking = threading.Lock()
        self._ids = np.zeros(0, np.int64)  # of the marked keyframes
        self._marked_at = np.zeros((0, 4, 4))  # their T_world_cam then
        self._information = np.zeros((0, 0, 0), np.float32)
        self._occupancy: Occupancy | None = None
        self._meter = DistanceMeter()
        self._cells: SeenCells | None = None

    @property
    def cells(self) -> int:
        """Number of cells that are kept."""
        return self._information.size

    def follow(self, keyframes: MapKeyframes) -> SeenCells:
        """Mark new keyframes; mark all anew if corrections moved surfaces by a cell.

        Until then retired keyframes stay marked.

        Raises:
            UserError: there was no keyframe yet.
        """
        with self._marking:
            for _ in self._mark_new(keyframes):
                pass
            return self._seen_cells(keyframes)

    def follow_for(self, keyframes: MapKeyframes, seconds: float) -> SeenCells | int:
        """As `follow`, but stops after `seconds`: then the number of keyframes left for the next call."""
        deadline_s = time.monotonic() + seconds
        with self._marking:
            for left in self._mark_new(keyframes):
                if left and time.monotonic() >= deadline_s:
                    return left
            return self._seen_cells(keyframes)

    def _mark_new(self, keyframes: MapKeyframes) -> Iterator[int]:
        """Mark one after the other; yields the number left after each."""
        if self._moved(keyframes):
            self._occupancy, self._ids, self._marked_at = None, self._ids[:0], self._marked_at[:0]
            self._cells = None
        is_new = self._may_see(keyframes) & ~np.isin(keyframes.ids, self._ids)
        new = np.flatnonzero(is_new).tolist()
        for n, k in enumerate(new, 1):
            depth_m, T_world_cam = keyframes.views[k]
            depth_m = np.where(depth_m <= self._max_depth_m, depth_m, 0)
            occupancy = self._with_room(depth_m, keyframes.camera, T_world_cam)
            if occupancy is not None:
                occupancy.observe(depth_m, keyframes.camera, T_world_cam)
                self._mark(depth_m, keyframes.camera, T_world_cam)
            self._ids = np.append(self._ids, keyframes.ids[k])
            self._marked_at = np.concatenate([self._marked_at, T_world_cam[None]])
            self._cells = None
            yield len(new) - n

    def _seen_cells(self, keyframes: MapKeyframes) -> SeenCells:
        if self._cells is None:
            if not len(keyframes):
                raise UserError("the map has no keyframes: expected one or more")
            if (occupancy := self._occupancy) is None:
                assert self._within is not None  # in which no keyframe saw anything
                low = np.array(self._within.low)
                occupancy = self._begin(self._grid(low, low + self._cell_m))
            distances = self._meter.measure(occupancy)
            # a copy: earlier answers must not change
            information = self._information.copy(order="F")
            self._cells = SeenCells(occupancy.grid, information, distances)
        return self._cells

    def _moved(self, keyframes: MapKeyframes) -> bool:
        _, now, then = np.intersect1d(keyframes.ids, self._ids, return_indices=True)
        shift_m = surface_shift_m(self._marked_at[then], keyframes.T_world_cam[now])
        return shift_m > self._cell_m

    def _may_see(self, keyframes: MapKeyframes) -> np.ndarray:
        """Mask [n] of the keyframes from which something in the box is near enough to be measured."""
        if self._within is None:
            return np.ones(len(keyframes), np.bool_)
        camera, places = keyframes.camera, keyframes.T_world_cam[:, :3, 3]
        aside = max(camera.cx, camera.width_px - camera.cx) / camera.fx
        above = max(camera.cy, camera.height_px - camera.cy) / camera.fy
        farthest_m = self._max_depth_m * np.linalg.norm([1.0, aside, above])
        nearest = np.clip(places, self._within.low, self._within.high)
        return np.linalg.norm(places - nearest, axis=1) < farthest_m

    def _begin(self, grid: VoxelGrid) -> Occupancy:
        """Take this grid as the first one."""
        self._information = np.zeros(grid.shape, np.float32, order="F")
        self._occupancy = Occupancy(grid, far_m=self._far_m, max_depth_m=self._max_depth_m)
        return self._occupancy

    def _grid(self, low: np.ndarray, high: np.ndarray) -> VoxelGrid:
        """The grid between two corners [3] m, as far as it may go."""
        if self._within is not None:
            low, high = np.maximum(low, self._within.low), np.minimum(high, self._within.high)
        grid = VoxelGrid.over(Bound.of(low, high), self._cell_m)
        if self._expect_room is not None:
            self._expect_room(grid.count)
        return grid

    def _with_room(
        self, depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray
    ) -> Occupancy | None:
        """The occupancy, on a grid that covers what a keyframe sees in the box; None: nothing."""
        low, high = _extent(depth_m, camera, T_world_cam)
        if self._within is not None:
            low, high = np.maximum(low, self._within.low), np.minimum(high, self._within.high)
            if (low > high).any():
                return None
        occupancy = self._occupancy
        if occupancy is None:
            return self._begin(self._grid(low - _MARGIN_M, high + _MARGIN_M))
        before = occupancy.grid
        is_low, is_high = low < before.low, high > before.high
        if is_low.any() or is_high.any():
            low = np.where(is_low, low - _MARGIN_M, before.low)
            high = np.where(is_high, high + _MARGIN_M, before.high)
            grid = self._grid(low, high)
            information = np.zeros(grid.shape, np.float32, order="F")
            information[before.within(grid)] = self._information
            self._information = information
            occupancy.grow_to(grid)
        return occupancy

    def _mark(self, depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray) -> None:
        """Add the information that a keyframe's depth gives of the cells that it saw."""
        assert self._occupancy is not None
        T_cam_world, grid = inverse(T_world_cam), self._occupancy.grid
        T_cam_index = T_cam_world.copy()
        T_cam_index[:3, :3] *= grid.voxel_m
        T_cam_index[:3, 3] += T_cam_world[:3, :3] @ grid.centres(np.zeros(3))
        intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        depth_m = np.ascontiguousarray(depth_m, np.float32)
        far_m = float(depth_m.max(initial=0.0)) + self._reach_m
        add_information(depth_m, intrinsics, T_cam_index, self._reach_m, far_m, self._information)


def _extent(
    depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners [3] m of a box around a camera and what it measured."""
    points = world_points(depth_m, camera, T_world_cam, _EXTENT_PX)
    points = np.concatenate([points, T_world_cam[None, :3, 3]])
    return points.min(axis=0), points.max(axis=0)
