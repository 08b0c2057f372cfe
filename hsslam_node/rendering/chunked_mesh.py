"""A triangle mesh in chunks of 64 faces with a box each; a file of its own as three measures share it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hsslam_node.kernels.compiled import njit

CHUNK = 64  # faces; neighbours in a mesh file are mostly neighbours in space


class ChunkedMesh(NamedTuple):
    """The form that kernels take."""

    vertices: np.ndarray  # [N, 3] float64 m
    faces: np.ndarray  # [F, 3] int64
    boxes: np.ndarray  # [ceil(F / 64), 2, 3] float64 m, lowest and highest coordinates of a chunk


def chunked_mesh(vertices: ArrayLike, faces: ArrayLike) -> ChunkedMesh:
    """Divide vertices [N, 3] m and faces [F, 3] into chunks; compute the boxes, once for many views."""
    vertices = np.ascontiguousarray(vertices, np.float64).reshape(-1, 3)
    faces = np.ascontiguousarray(faces, np.int64).reshape(-1, 3)
    return ChunkedMesh(vertices, faces, _boxes(vertices, faces))


@njit(cache=True, nogil=True, error_model="numpy")
def _boxes(vertices, faces):
    boxes = np.empty((-(-len(faces) // CHUNK), 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    for f in range(len(faces)):
        box = boxes[f // CHUNK]
        for corner in range(3):
            for a in range(3):
                x = vertices[faces[f, corner], a]
                box[0, a] = min(box[0, a], x)
                box[1, a] = max(box[1, a], x)
    return boxes
