"""Which keyframes the live mesh has marked, and where they stood: marks follow corrected poses."""

from collections.abc import Callable

import numpy as np

from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.view_distance import surface_shift_m
from hsslam_node.meshing.live_mesh import HasTime, LiveMesh
from hsslam_node.meshing.sparse_space import SparseSpace

_MARGIN_M = 4.0  # around the bound: a keyframe may come before the map has grown to what it sees


class MarkedKeyframes:
    """Marks keyframes in the space of a live mesh, new ones first.

    After a loop all are marked again at their corrected poses, some in each refresh, in a second space that
    takes the place of the first one when it is complete.
    """

    def __init__(self, mesh: LiveMesh) -> None:
        self._mesh = mesh
        self._bound: Bound | None = None
        self._is_behind = False
        self._marked_at = np.zeros((0, 4, 4))  # T_world_cam of the keyframes marked so far
        self._second: SparseSpace | None = None
        self._second_at = np.zeros((0, 4, 4))  # those marked again so far

    @property
    def is_behind(self) -> bool:
        """Whether there was no time for all keyframes, or they are being marked again."""
        return self._is_behind or self._second is not None

    def cover(self, bound: Bound) -> None:
        """Follow the bound of the map."""
        if bound == self._bound:
            return
        self._bound = bound
        for space in (self._mesh.space, self._second):
            if space is not None:
                space.cover(_wider(bound))
        self._mesh.want_hidden()

    def mark(
        self,
        poses: np.ndarray,
        camera: Camera,
        depth_m: Callable[[int], np.ndarray],
        has_time: HasTime,
    ) -> None:
        """Mark what is new or has moved while there is time, and want the blocks that change.

        Args:
            poses: T_world_cam [n, 4, 4] of all keyframes now.
            camera: of all keyframes.
            depth_m: gives the depth [H, W] of keyframe k, m.
            has_time: asked between keyframes; one is marked in any case.
        """
        first = len(self._marked_at)
        end = first
        while end < len(poses) and (end == first or has_time()):
            self._mesh.space.observe(depth_m(end), camera, poses[end])
            end += 1
        self._is_behind = end < len(poses)
        self._marked_at = np.concatenate([self._marked_at, poses[first:end]])
        if self._second is None and self._moved(poses):
            self._second = SparseSpace(self._mesh.space.voxel_m, self._mesh.space.block_cells)
            self._second_at = np.zeros((0, 4, 4))
            if self._bound is not None:
                self._second.cover(_wider(self._bound))
        if self._second is not None:
            self._mark_again(self._second, poses, camera, depth_m, has_time)
        self._mesh.look_at(self._mesh.space.take_grown())

    def _mark_again(
        self,
        space: SparseSpace,
        poses: np.ndarray,
        camera: Camera,
        depth_m: Callable[[int], np.ndarray],
        has_time: HasTime,
    ) -> None:
        first, count = len(self._second_at), len(self._marked_at)
        end = first
        while end < count and (end == first or has_time()):
            space.observe(depth_m(end), camera, poses[end])
            end += 1
        self._second_at = np.concatenate([self._second_at, poses[first:end]])
        if end < count:
            return
        self._mesh.take_space(space)
        self._marked_at, self._second = self._second_at, None

    def _moved(self, poses: np.ndarray) -> bool:
        known = min(len(poses), len(self._marked_at))
        shift_m = surface_shift_m(self._marked_at[:known], poses[:known])
        return shift_m > self._mesh.space.voxel_m  # less than that stays within what is asked


def _wider(bound: Bound) -> Bound:
    return Bound.of(np.subtract(bound.low, _MARGIN_M), np.add(bound.high, _MARGIN_M))
