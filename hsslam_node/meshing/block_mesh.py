"""The mesh of one block of the live mesh; apart from `weld`, as the mesher needs no trimesh."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.kernels.compiled import njit


@dataclass(frozen=True)
class BlockMesh:
    """The mesh of one block."""

    block: tuple[int, int, int]
    vertices: np.ndarray  # [V, 3] float32, cells from the block's first vertex
    faces: np.ndarray  # [F, 3] int32
    colors: np.ndarray  # [V, 3] uint8


def without_specks(mesh: BlockMesh, block_cells: int, min_faces: int) -> BlockMesh | None:
    """The mesh of a block without small pieces, unless they reach a neighbour; None if nothing stays."""
    label = components(mesh.faces.astype(np.int64), len(mesh.vertices))
    at_side = ((mesh.vertices <= 0) | (mesh.vertices >= block_cells)).any(axis=1)
    stays = np.bincount(label[mesh.faces[:, 0]], minlength=label.max() + 1) >= min_faces
    stays[label[at_side]] = True
    keep = stays[label[mesh.faces[:, 0]]]
    if keep.all():
        return mesh
    if not keep.any():
        return None
    used, faces = np.unique(mesh.faces[keep], return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    return BlockMesh(mesh.block, mesh.vertices[used], faces, mesh.colors[used])


@njit(cache=True, nogil=True)
def components(faces, vertex_count):
    """Number [V] of the connected piece of each vertex; numbers have gaps."""
    parent = np.arange(vertex_count)
    for face in range(len(faces)):
        a = _root(parent, faces[face, 0])
        for corner in range(1, 3):
            b = _root(parent, faces[face, corner])
            parent[max(a, b)] = min(a, b)
            a = min(a, b)
    for vertex in range(vertex_count):
        parent[vertex] = _root(parent, vertex)
    return parent


@njit(cache=True, nogil=True)
def _root(parent, vertex):
    while parent[vertex] != vertex:
        parent[vertex] = parent[parent[vertex]]
        vertex = parent[vertex]
    return vertex
