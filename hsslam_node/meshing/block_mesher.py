"""Incremental meshing: only observed space is asked, only changed blocks are asked again."""

from dataclasses import dataclass

import numpy as np
import trimesh

from hsslam_node.geometry.camera import Camera
from hsslam_node.meshing.block_surface import QueryColor, QuerySdf, block_surface
from hsslam_node.meshing.observed_space import ObservedSpace
from hsslam_node.meshing.weld import BlockMesh, weld_blocks


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
            mesh, asked = block_surface(self.space, block, query_sdf, query_color)
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
