"""Triangle meshes to messages and back."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hsslam_proto.block_revisions import Block
from hsslam_proto.mesh.messages import Mesh, MeshBlocks


class Triangles(NamedTuple):
    """Vertices [V, 3] float32 m world, faces [F, 3] uint32, colors [V, 3] uint8 RGB."""

    vertices: np.ndarray
    faces: np.ndarray
    colors: np.ndarray


class BlockLattice(NamedTuple):
    """Sizes that all blocks of a mesh share, m."""

    voxel_m: float
    block_m: float


def mesh_message(
    vertices: np.ndarray,
    faces: np.ndarray,
    colors: np.ndarray,
    map_version: int,
    final: bool = False,
    map_epoch: int = 0,
) -> Mesh:
    """Vertices [V, 3] m world, faces [F, 3], colors [V, 3] uint8 RGB as a message."""
    return Mesh(
        map_version=map_version,
        vertex_count=len(vertices),
        face_count=len(faces),
        vertices=_bytes(vertices, "<f4"),
        faces=_bytes(faces, "<u4"),
        colors=_bytes(colors, "u1"),
        final=final,
        map_epoch=map_epoch,
    )


def mesh_arrays(mesh: Mesh) -> Triangles:
    """The triangles of a message; copies."""
    return Triangles(
        _rows(mesh.vertices, "<f4"),
        _rows(mesh.faces, "<u4"),
        _rows(mesh.colors, "u1"),
    )


def blocks_message(
    changed: Sequence[tuple[Block, Triangles | None]],
    lattice: BlockLattice,
    *,
    series: int,
    revision: int,
    map_version: int,
    map_epoch: int = 0,
) -> MeshBlocks:
    """Blocks with their triangles (None: the block has no surface any more) as a message."""
    meshes = [_NOTHING if mesh is None else mesh for _, mesh in changed]
    return MeshBlocks(
        series=series,
        revision=revision,
        map_version=map_version,
        voxel_m=lattice.voxel_m,
        block_m=lattice.block_m,
        blocks=_bytes(np.array([block for block, _ in changed], "<i4").reshape(-1, 3), "<i4"),
        vertex_counts=_bytes(np.array([len(mesh.vertices) for mesh in meshes]), "<u4"),
        face_counts=_bytes(np.array([len(mesh.faces) for mesh in meshes]), "<u4"),
        vertices=_bytes(np.concatenate([_NOTHING.vertices, *(m.vertices for m in meshes)]), "<f4"),
        faces=_bytes(np.concatenate([_NOTHING.faces, *(m.faces for m in meshes)]), "<u4"),
        colors=_bytes(np.concatenate([_NOTHING.colors, *(m.colors for m in meshes)]), "u1"),
        map_epoch=map_epoch,
    )


def block_triangles(message: MeshBlocks) -> dict[Block, Triangles | None]:
    """Copies of the blocks of a message; None: the block has no surface any more."""
    vertices, faces = _rows(message.vertices, "<f4"), _rows(message.faces, "<u4")
    colors = _rows(message.colors, "u1")
    found: dict[Block, Triangles | None] = {}
    vertex = face = 0
    counts = zip(
        _rows(message.blocks, "<i4").tolist(),
        np.frombuffer(message.vertex_counts, "<u4").tolist(),
        np.frombuffer(message.face_counts, "<u4").tolist(),
        strict=True,
    )
    for (i, j, k), vertex_count, face_count in counts:
        of_block = slice(vertex, vertex + vertex_count)
        triangles = faces[face : face + face_count]
        vertex, face = vertex + vertex_count, face + face_count
        mesh = Triangles(vertices[of_block], triangles, colors[of_block])
        found[i, j, k] = mesh if face_count else None
    return found


_NOTHING = Triangles(
    np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32), np.zeros((0, 3), np.uint8)
)


def _bytes(array: np.ndarray, dtype: str) -> memoryview:
    flat = np.ascontiguousarray(array, dtype).reshape(-1)
    return flat.view(np.uint8).data


def _rows(data: memoryview, dtype: str) -> np.ndarray:
    # bytes in a payload are not aligned: native code wants them aligned
    return np.frombuffer(data, dtype).reshape(-1, 3).copy()
