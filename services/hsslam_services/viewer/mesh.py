"""Draws the mesh in the viewer: an entity for each block of the live mesh, one for the final mesh."""

import numpy as np
import rerun as rr

from hsslam_proto.block_revisions import Block
from hsslam_proto.mesh.assembled import BlockNews
from hsslam_proto.mesh.codec import Triangles, mesh_arrays
from hsslam_proto.mesh.messages import Mesh

ENTITY = "world/mesh"


def draw_blocks(stream: rr.RecordingStream, news: BlockNews) -> None:
    """Draw blocks as world/mesh/live/<i>_<j>_<k>."""
    if news.anew:
        stream.log(ENTITY, rr.Clear(recursive=True))
    for block, triangles in news.blocks.items():
        entity = f"{ENTITY}/live/{_name(block)}"
        if triangles is None:
            stream.log(entity, rr.Clear(recursive=False))
        else:
            stream.log(entity, _mesh3d(triangles))


def draw_whole(stream: rr.RecordingStream, mesh: Mesh) -> None:
    """Draw the final mesh as world/mesh/final in place of all blocks."""
    stream.log(ENTITY, rr.Clear(recursive=True))
    stream.log(f"{ENTITY}/final", _mesh3d(mesh_arrays(mesh)))


def _name(block: Block) -> str:
    return "_".join(map(str, block))


def _mesh3d(mesh: Triangles) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=mesh.vertices,
        triangle_indices=mesh.faces,
        vertex_normals=_vertex_normals(mesh.vertices, mesh.faces),
        vertex_colors=mesh.colors,
        # the viewer looks into a room through the back of its walls
        face_rendering=rr.components.MeshFaceRendering.Front,
    )


def _vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals [V, 3] float32, faces weighted by area; without them the viewer does not shade."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    face_normals = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for axis in range(3):
        weights = np.repeat(face_normals[:, axis], 3)
        normals[:, axis] = np.bincount(faces.ravel(), weights, minlength=len(vertices))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)
