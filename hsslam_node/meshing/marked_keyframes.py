"""The keyframes that the live mesh has marked, and their poses: marks follow corrected poses."""

from collections.abc import Callable, Mapping
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

    After a correction by more than a voxel it marks all kept keyframes again, some in each refresh, in a
    second space. When this is complete, it replaces the first. Memory and time follow the kept keyframes, not
    the length of the run.
    """

    def __init__(self, mesh: LiveMesh) -> None:
        self._mesh = mesh
        self._bound: Bound | None = None
        self._is_behind = False
        self._marked_at: dict[int, np.ndarray] = {}  # T_world_cam of keyframes marked so far, by id
        self._second: SparseSpace | None = None
        self._second_at: dict[int, np.ndarray] = {}  # of the keyframes marked again so far

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
        keyframes: Mapping[int, np.ndarray],
        camera: Camera,
        depth_m: DepthOf,
        has_time: HasTime,
    ) -> None:
        """Mark keyframes that are new or have moved, while there is time, and look at the blocks that grow.

        Args:
            keyframes: T_world_cam [4, 4] now of each kept keyframe, by id, ascending.
            camera: of all keyframes.
            depth_m: gives the depth [H, W] of keyframe k, m; None if it is retired meanwhile: others show the
                same.
            has_time: called between keyframes; it marks at least one.
        """
        self._marked_at = {k: T for k, T in self._marked_at.items() if k in keyframes}
        self._is_behind = not _mark(
            self._mesh.space, self._marked_at, keyframes, camera, depth_m, has_time
        )
        if self._second is None and self._moved(keyframes):
            self._second = SparseSpace(self._mesh.space.voxel_m, self._mesh.space.block_cells)
            self._second_at = {}
            if self._bound is not None:
                self._second.cover(_wider(self._bound))
        if self._second is not None:
            again = {k: keyframes[k] for k in self._marked_at}
            if _mark(self._second, self._second_at, again, camera, depth_m, has_time):
                self._mesh.take_space(self._second)
                self._marked_at, self._second = self._second_at, None
        self._mesh.look_at(self._mesh.space.take_grown())

    def _moved(self, keyframes: Mapping[int, np.ndarray]) -> bool:
        then = np.array([*self._marked_at.values()]).reshape(-1, 4, 4)
        now = np.array([keyframes[k] for k in self._marked_at]).reshape(-1, 4, 4)
        # smaller shifts stay within the marks
        return surface_shift_m(then, now) > self._mesh.space.voxel_m


def _mark(
    space: SparseSpace,
    marked_at: dict[int, np.ndarray],
    keyframes: Mapping[int, np.ndarray],
    camera: Camera,
    depth_m: DepthOf,
    has_time: HasTime,
) -> bool:
    """Mark keyframes that are not in `marked_at`, and note their poses there; whether all are marked now."""
    new = [k for k in keyframes if k not in marked_at]
    for number, k in enumerate(new):
        if number and not has_time():
            return False
        if (depth := depth_m(k)) is not None:
            space.observe(depth, camera, keyframes[k])
        marked_at[k] = keyframes[k].copy()  # a view would hold the poses of all
    return True


def _wider(bound: Bound) -> Bound:
    return Bound.of(np.subtract(bound.low, _MARGIN_M), np.add(bound.high, _MARGIN_M))
