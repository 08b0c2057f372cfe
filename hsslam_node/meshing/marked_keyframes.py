"""The keyframes that the live mesh has marked, and their poses: marks follow corrected poses."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.view_distance import surface_shift_m
from hsslam_node.meshing.live_mesh import HasTime, LiveMesh
from hsslam_node.meshing.sparse_space import SparseSpace

DepthOf: TypeAlias = Callable[[int], np.ndarray | None]
_MARGIN_M = 4.0  # around the bound: a keyframe may come before the map has grown to what it sees


class MarkedKeyframes:
    """Marks keyframes in the space of a live mesh, new ones first.

    After a correction by more than a voxel it marks all keyframes again, some in each refresh, in a second
    space. When this is complete, it replaces the first.
    """

    def __init__(self, mesh: LiveMesh) -> None:
        self._mesh = mesh
        self._bound: Bound | None = None
        self._is_behind = False
        self._marked_at = np.zeros((0, 4, 4))  # T_world_cam of the keyframes marked so far
        self._second: SparseSpace | None = None
        self._second_at = np.zeros((0, 4, 4))  # of the keyframes marked again so far

    @property
    def is_behind(self) -> bool:
        """Whether some keyframes are still to be marked, for the first time or again."""
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
        depth_m: DepthOf,
        has_time: HasTime,
    ) -> None:
        """Mark keyframes that are new or have moved, while there is time, and look at the blocks that grow.

        Args:
            poses: T_world_cam [n, 4, 4] of all keyframes now.
            camera: of all keyframes.
            depth_m: gives the depth [H, W] of keyframe k, m; None if it is retired: others show the same.
            has_time: called between keyframes; it marks at least one.
        """
        self._marked_at = _marked(
            self._mesh.space, self._marked_at, poses, camera, depth_m, has_time
        )
        self._is_behind = len(self._marked_at) < len(poses)
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
        depth_m: DepthOf,
        has_time: HasTime,
    ) -> None:
        count = len(self._marked_at)
        self._second_at = _marked(space, self._second_at, poses[:count], camera, depth_m, has_time)
        if len(self._second_at) < count:
            return
        self._mesh.take_space(space)
        self._marked_at, self._second = self._second_at, None

    def _moved(self, poses: np.ndarray) -> bool:
        known = min(len(poses), len(self._marked_at))
        shift_m = surface_shift_m(self._marked_at[:known], poses[:known])
        return shift_m > self._mesh.space.voxel_m  # smaller shifts stay within the marks


def _marked(
    space: SparseSpace,
    before: np.ndarray,
    poses: np.ndarray,
    camera: Camera,
    depth_m: DepthOf,
    has_time: HasTime,
) -> np.ndarray:
    """Mark keyframes behind those at poses `before` [m, 4, 4]; returns the poses [k, 4, 4] of all marked."""
    first = end = len(before)
    while end < len(poses) and (end == first or has_time()):
        if (depth := depth_m(end)) is not None:
            space.observe(depth, camera, poses[end])
        end += 1
    return before if end == first else np.concatenate([before, poses[first:end]])


def _wider(bound: Bound) -> Bound:
    return Bound.of(np.subtract(bound.low, _MARGIN_M), np.add(bound.high, _MARGIN_M))
