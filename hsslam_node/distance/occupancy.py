"""Which voxels are free, which occupied, from the depth images that saw them."""

import numpy as np

from hsslam_node.distance.kernels.depth_extremes import depth_extremes
from hsslam_node.distance.kernels.hits import (
    Touched,
    add_hits,
    forget_hits,
    gather_hits,
    touched,
)
from hsslam_node.distance.kernels.known_voxels import room_for_states, write_states
from hsslam_node.distance.kernels.passes import add_passes
from hsslam_node.distance.kernels.shift import shift
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.presets import REALTIME

FAR_M = 4.0  # with 6 m, noise of a Kinect leaves surfaces in free space (docs/maps.md)
_SLACK = 8  # a window moves when its wanted middle is this share of its side away
_RECORD_BYTES = 8


def expect_far(far_m: float) -> None:
    """Raise UserError unless the largest distance that counts is above 0 (so none is nan)."""
    if not (isinstance(far_m, int | float | np.number) and far_m > 0):
        raise UserError(f"far_m = {far_m!r}: expected metres above 0")


class Occupancy:
    """Evidence for every voxel of a grid: images that saw a surface in it, and images that saw through it.

    Evidence is bounded, so what is carried away is free after at most six images that see through it.
    Memory is 13 bytes a voxel.

    Args:
        grid: of a frame of its own.
        T_grid_world: that of poses to that of the grid, [4, 4]; None: they are the same.
        far_m: farther measurements say that the way up to there is free, and nothing else.
        max_depth_m: those beyond say nothing.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        T_grid_world: np.ndarray | None = None,
        far_m: float = FAR_M,
        max_depth_m: float = REALTIME.mapper.max_depth_m,
    ) -> None:
        expect_far(far_m)
        self.grid = grid
        self.T_grid_world = np.eye(4) if T_grid_world is None else np.array(T_grid_world)
        self._far_m, self._max_depth_m = far_m, max_depth_m
        self._evidence = np.zeros(grid.shape[::-1], np.int8)  # [nz, ny, nx]
        self._surface = np.zeros((*grid.shape[::-1], _RECORD_BYTES), np.int8)
        self._touched: Touched | None = None
        self._states: np.ndarray | None = None  # if nothing has changed since they were asked for
        self._known_box, self._occupied = np.zeros((2, 3), np.int64), 0  # of them

    def observe(
        self, depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray, stride_px: int = 1
    ) -> None:
        """Take in one depth image.

        Args:
            depth_m: [H, W] float32, planar, 0 = no measurement.
            camera: undistorted.
            T_world_cam: [4, 4].
            stride_px: step between the pixels that are looked at, both ways; it should leave a voxel that
                is `far_m` away two pixels or more.
        """
        image = depth_extremes(depth_m, camera, stride_px, self._max_depth_m)
        if self._touched is None or len(self._touched.voxel) <= image.depth.size:
            self._touched = touched(self._evidence.shape, image.depth.size)
        marks, voxel_m, far_m = self._touched, self.grid.voxel_m, self._far_m
        T = self.grid.T_index_frame() @ self.T_grid_world @ T_world_cam
        T_index_cam, T_cam_index = T[:3].copy(), np.linalg.inv(T)[:3].copy()
        used = gather_hits(image, T_index_cam, far_m, marks)
        add_hits(image, T_index_cam, voxel_m, far_m, marks, used, self._evidence, self._surface)
        add_passes(image, T_cam_index, voxel_m, far_m, marks.slot, self._evidence)
        forget_hits(marks, used)
        self._states = None

    def move_to(self, centre: np.ndarray) -> bool:
        """Let the window follow a point [3] m, world; True if it moved.

        It moves once the point is an eighth of its side away from the middle. What it holds stays where it
        is in the world; what it leaves is forgotten.
        """
        point = self.T_grid_world[:3, :3] @ centre + self.T_grid_world[:3, 3]
        shape = np.asarray(self.grid.shape)
        steps = np.rint(point / self.grid.voxel_m - self.grid.first - shape / 2).astype(np.int64)
        steps[np.abs(steps) * _SLACK < shape] = 0
        if not steps.any():
            return False
        self.grid = self.grid.moved(steps)
        shift(self._evidence, steps[::-1])
        shift(self._surface.view(np.int64)[..., 0], steps[::-1])
        self._states = None
        return True

    def grow_to(self, grid: VoxelGrid) -> None:
        """Go on with a grid that covers this one; all of the evidence stays.

        Raises:
            ValueError: it does not cover it.
        """
        place = self.grid.within(grid)[::-1]
        evidence, surface = self._evidence, self._surface
        self._evidence = np.zeros(grid.shape[::-1], np.int8)
        self._surface = np.zeros((*grid.shape[::-1], _RECORD_BYTES), np.int8)
        self._evidence[place], self._surface[place] = evidence, surface
        self.grid, self._touched, self._states = grid, None, None

    def fill_from(self, other: "Occupancy") -> None:
        """Take over what another one of the same grid knows about voxels without any evidence here.

        Raises:
            ValueError: it has another grid.
        """
        if other.grid != self.grid:
            raise ValueError(f"{other.grid} is not {self.grid}")
        is_empty = (self._evidence == 0) & (self._surface.view(np.int64)[..., 0] == 0)
        np.copyto(self._evidence, other._evidence, where=is_empty)
        np.copyto(self._surface, other._surface, where=is_empty[..., None])
        self._states = None

    def states(self) -> np.ndarray:
        """UNKNOWN, FREE or OCCUPIED of each voxel, [nx, ny, nz] uint8; not to be written to."""
        if self._states is None:
            self._states = room_for_states(self._evidence.shape)
            self._occupied = write_states(self._evidence, self._states, self._known_box)
            self._states.flags.writeable = False
        return self._states.T

    def known_box(self) -> tuple[np.ndarray, int]:
        """First and end (z, y, x) of the voxels that are known, [2, 3] int64, or a little more; how many are
        occupied."""
        self.states()
        return self._known_box.copy(), self._occupied

    def surfaces(self) -> np.ndarray:
        """What occupied voxels keep of their surface, [8, nx, ny, nz] int8 (`surface_record.py`)."""
        return self._surface.T
