"""The former place of an object that was carried off: whether frames see through it, and maps free it."""

from dataclasses import dataclass

import numpy as np

from hsslam_bench.field_error.true_frames import TrueFrame
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.grid_map import CELL_FREE, CELL_OCCUPIED, LOW_M, GridMap
from hsslam_node.geometry.se3 import inverse, transformed
from hsslam_node.synth.rendering.scene_mesh import scene_mesh
from hsslam_node.synth.scenes.carried_off import CarriedOff

_ABOVE_FLOOR_M = 0.05  # lower points are of the floor or its carpet
_THROUGH_M = 0.05  # a pixel sees through a point if its depth is larger by this
_FREE_M = 0.05  # a voxel; no other surface is so near


@dataclass(frozen=True)
class FormerPlace:
    """The former place of an object, in the room and in the world of a run."""

    points: np.ndarray  # [N, 3] m, world: of its surface, above the heights that the grid ignores
    box_m: np.ndarray  # [2, 3], low and high corner in the room, above the floor
    T_room_world: np.ndarray  # [4, 4]

    @classmethod
    def of(cls, thing: CarriedOff, T_room_world: np.ndarray) -> "FormerPlace":
        """The place of an object; the room has z up and its floor at z = 0."""
        vertices = np.asarray(scene_mesh(list(thing.parts)).vertices)
        high = vertices[vertices[:, 2] > LOW_M + _ABOVE_FLOOR_M]
        box_m = thing.box_m
        box_m[0, 2] = _ABOVE_FLOOR_M
        return cls(transformed(inverse(T_room_world), high), box_m, T_room_world)

    def seen_through(self, view: TrueFrame) -> np.ndarray:
        """Mask [N] of the points that lie in the image, in front of the true depth there."""
        camera = view.frame.camera
        x, y, z = transformed(inverse(view.T_world_cam), self.points).T
        ahead = np.maximum(z, 1e-6)
        column = np.rint(camera.fx * x / ahead + camera.cx).astype(np.int64)
        row = np.rint(camera.fy * y / ahead + camera.cy).astype(np.int64)
        inside = (z > 0.1) & (column >= 0) & (row >= 0)
        inside &= (column < camera.width_px) & (row < camera.height_px)
        through = np.zeros(len(self.points), np.bool_)
        depth_m = view.depth_m[row[inside], column[inside]]
        through[inside] = depth_m > z[inside] + _THROUGH_M
        return through

    def is_free_in_grid(self, grid: GridMap) -> bool:
        """Whether all cells of the place are free."""
        return bool((self._cells(grid) == CELL_FREE).all())

    def is_occupied_in_grid(self, grid: GridMap) -> bool:
        """Whether at least half of the points lie in occupied cells."""
        return bool((self._cells(grid) == CELL_OCCUPIED).mean() >= 0.5)

    def is_free_in(self, distances: DistanceMap) -> bool:
        """Whether all points are known, and farther than a voxel from any surface."""
        found = distances.query(self.points.astype(np.float32))
        return bool(found.known.all() and (found.distance_m > _FREE_M).all())

    def count_inside(self, vertices: np.ndarray) -> int:
        """Number of the vertices [V, 3] m, world, that lie in the box."""
        places = transformed(self.T_room_world, vertices)
        low, high = self.box_m
        return int(((places > low) & (places < high)).all(axis=1).sum())

    def _cells(self, grid: GridMap) -> np.ndarray:
        return grid.cells_at(transformed(grid.T_floor_world, self.points)[:, :2])
