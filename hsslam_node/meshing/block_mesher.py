"""Incremental meshing: only observed space is asked, only changed blocks are asked again."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh
from skimage.measure import marching_cubes

from hsslam_node.geometry.camera import Camera
from hsslam_node.meshing.observed_space import ObservedSpace
from hsslam_node.meshing.weld import BlockMesh, weld_blocks

QuerySdf = Callable[[np.ndarray], np.ndarray]
"""points [N, 3] float32 m, world -> signed distance [N], any unit, positive in free space."""
QueryColor = Callable[[np.ndarray], np.ndarray]
"""points [N, 3] float32 m, world -> RGB [N, 3], 0..1."""


@dataclass(frozen=True)
class MeshUpdate:
    """What one update did."""

    blocks: int  # asked again
    waiting: int  # still dirty
    queries: int  # signed distances asked for


class BlockMesher:
    """Keeps one mesh per block of observed space and asks the field again only where it changed.

    Example:
        mesher = BlockMesher(ObservedSpace(bound, voxel_m=0.03))
        mesher.observe(depth_m, camera, T_world_cam)
        mesher.update(query_sdf, query_color)
        mesher.mesh().export("mesh.ply")
    """

    def __init__(self, space: ObservedSpace) -> None:
        self.space = space
        self._blocks: dict[tuple[int, int, int], BlockMesh] = {}
        self._waiting: dict[tuple[int, int, int], None] = {}  # in order of arrival

    def observe(
        self, depth_m: np.ndarray, camera: Camera, T_world_cam: np.ndarray, stride_px: int = 2
    ) -> None:
        """Take in one keyframe; see `ObservedSpace.observe`."""
        self.space.observe(depth_m, camera, T_world_cam, stride_px)
        self._waiting.update(dict.fromkeys(self.space.take_dirty()))

    def mark_all_changed(self) -> None:
        """Ask every observed block again at the next update (the whole map has moved on)."""
        self._waiting.update(dict.fromkeys(self.space.occupied_blocks()))

    def clear(self) -> None:
        """Forget observations and meshes; observe the keyframes again at their corrected poses."""
        self.space.clear()
        self._blocks.clear()
        self._waiting.clear()

    def update(
        self, query_sdf: QuerySdf, query_color: QueryColor, max_blocks: int | None = None
    ) -> MeshUpdate:
        """Mesh the changed blocks again, oldest change first, at most `max_blocks` of them."""
        todo = list(self._waiting)[:max_blocks]
        queries = 0
        for block in todo:
            mesh, asked = self._mesh_block(block, query_sdf, query_color)
            queries += asked
            del self._waiting[block]
            if mesh is None:
                self._blocks.pop(block, None)
            else:
                self._blocks[block] = mesh
        return MeshUpdate(len(todo), len(self._waiting), queries)

    def mesh(self, min_component_faces: int = 50) -> trimesh.Trimesh:
        """The mesh of all blocks, welded, with vertex colours; metres, world.

        Args:
            min_component_faces: smaller connected pieces are left out.
        """
        ordered = [self._blocks[b] for b in sorted(self._blocks)]
        return weld_blocks(ordered, self.space, min_component_faces)

    def _mesh_block(
        self, block: tuple[int, int, int], query_sdf: QuerySdf, query_color: QueryColor
    ) -> tuple[BlockMesh | None, int]:
        """Mesh of one block, None where it has no surface, and the number of distances asked."""
        cells = self.space.cells(block)
        corners = np.zeros(np.add(cells.shape, 1), np.bool_)
        for i, j, k in np.ndindex(2, 2, 2):
            n0, n1, n2 = cells.shape
            corners[i : i + n0, j : j + n1, k : k + n2] |= cells
        vertices = np.argwhere(corners)
        if len(vertices) == 0:
            return None, 0
        sdf = np.ones(corners.shape, np.float32)
        sdf[corners] = query_sdf(self.space.vertex_positions(block, vertices))
        inside = sdf[corners] < 0
        if not inside.any() or inside.all():
            return None, len(vertices)
        mask = np.zeros_like(corners)  # scikit-image masks a cell at its far corner
        mask[1:, 1:, 1:] = cells
        try:
            local, faces, _, _ = marching_cubes(sdf, 0.0, mask=mask)
        except RuntimeError:  # no surface within the mask
            return None, len(vertices)
        color = query_color(self.space.vertex_positions(block, local))
        rgb = np.clip(np.asarray(color) * 255.0 + 0.5, 0, 255).astype(np.uint8)
        return BlockMesh(block, local.astype(np.float32), faces.astype(np.int64), rgb), len(
            vertices
        )
