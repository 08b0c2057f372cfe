"""Joining the meshes of blocks into one."""

from collections.abc import Sequence

import numpy as np
import trimesh

from hsslam_node.meshing.block_grid import BlockGrid, edges_in_half_cells
from hsslam_node.meshing.block_mesh import BlockMesh, components

_SNAP_CELLS = 1e-3  # vertices this close to a grid vertex are that vertex


def weld_blocks(
    blocks: Sequence[BlockMesh], space: BlockGrid, min_component_faces: int
) -> trimesh.Trimesh:
    """Join blocks into one mesh, m, world: merge vertices on the same grid edge, drop small pieces.

    Vertices match by grid edge, not by distance, so blocks of two map versions still join.
    """
    if not blocks:
        return trimesh.Trimesh(process=False)
    keys = np.concatenate([_edge_keys(b, space) for b in blocks])
    offsets = np.cumsum([0, *(len(b.vertices) for b in blocks)])
    faces = np.concatenate([b.faces + o for b, o in zip(blocks, offsets, strict=False)])
    points = np.concatenate([space.vertex_positions(b.block, b.vertices) for b in blocks])
    colors = np.concatenate([b.colors for b in blocks])

    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    points, colors, faces = points[first], colors[first], inverse.reshape(-1)[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    faces = _without_small_components(faces, len(points), min_component_faces)
    return _compact(points, faces, colors)


def kept_faces(
    mesh: trimesh.Trimesh, keep: np.ndarray, min_component_faces: int
) -> trimesh.Trimesh:
    """The mesh of the faces marked in `keep` [F] bool, without small connected pieces; colours stay."""
    if not keep.any():
        return trimesh.Trimesh(process=False)
    faces = np.asarray(mesh.faces)[keep]
    faces = _without_small_components(faces, len(mesh.vertices), min_component_faces)
    colors = np.asarray(mesh.visual.vertex_colors)[:, :3]  # type: ignore[union-attr]
    return _compact(np.asarray(mesh.vertices), faces, colors)


def _edge_keys(mesh: BlockMesh, space: BlockGrid) -> np.ndarray:
    """Place of each vertex on the doubled grid, odd along its edge, as one number, [V] int64."""
    doubled = edges_in_half_cells(mesh.vertices, _SNAP_CELLS)
    doubled += 2 * np.multiply(mesh.block, space.block_cells)
    size = 2 * np.multiply(space.block_count, space.block_cells) + 1
    return (doubled[:, 0] * size[1] + doubled[:, 1]) * size[2] + doubled[:, 2]


def _without_small_components(faces: np.ndarray, vertex_count: int, minimum: int) -> np.ndarray:
    label_of_face = components(faces, vertex_count)[faces[:, 0]]
    return faces[np.bincount(label_of_face, minlength=1)[label_of_face] >= minimum]


def _compact(points: np.ndarray, faces: np.ndarray, colors: np.ndarray) -> trimesh.Trimesh:
    """A mesh of the vertices that faces use."""
    used, faces = np.unique(faces, return_inverse=True)
    return trimesh.Trimesh(
        points[used], faces.reshape(-1, 3), vertex_colors=colors[used], process=False
    )
