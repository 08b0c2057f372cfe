"""Triangle meshes to messages and back."""

import numpy as np

from hsslam_proto.messages import Mesh


def mesh_message(
    vertices: np.ndarray,
    faces: np.ndarray,
    colors: np.ndarray,
    map_version: int,
    final: bool = False,
    world: int = 0,
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
        world=world,
    )


def mesh_arrays(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices [V, 3] float32 m world, faces [F, 3] uint32, colors [V, 3] uint8 RGB; copies."""
    return (
        _rows(mesh.vertices, "<f4"),
        _rows(mesh.faces, "<u4"),
        _rows(mesh.colors, "u1"),
    )


def _bytes(array: np.ndarray, dtype: str) -> memoryview:
    flat = np.ascontiguousarray(array, dtype).reshape(-1)
    return flat.view(np.uint8).data


def _rows(data: memoryview, dtype: str) -> np.ndarray:
    # the bytes lie anywhere in the payload: native code wants them aligned
    return np.frombuffer(data, dtype).reshape(-1, 3).copy()
