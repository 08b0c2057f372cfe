"""What a reader of meshes returned, as a mesh whose faces and vertices fit together; its readers share it."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hsslam_node.errors import UserError

if TYPE_CHECKING:
    import trimesh

_NO_TRIANGLES = "holds no triangles"
_LARGEST = 1e8  # m, of a coordinate


def triangle_mesh(loaded: object, path: Path, expected: str) -> "trimesh.Trimesh":
    """What `trimesh.load` made of a file, if it is a mesh; vertices that no face uses may be anything.

    Raises:
        UserError: it has no triangles, or a vertex of a face is missing, not finite or too far away; ends
            with `expected`.
    """
    import trimesh  # takes its time, and only the evaluator needs it

    if not isinstance(loaded, trimesh.Trimesh):
        raise UserError(f"{path}: {_NO_TRIANGLES}: {expected}")
    if problem := _problem(loaded.vertices, loaded.faces):
        raise UserError(f"{path}: {problem}: {expected}")
    return loaded


def _problem(vertices: np.ndarray, faces: np.ndarray) -> str:
    """What is wrong with triangles `faces` [F, 3] between `vertices` [V, 3] m; empty if nothing is."""
    if len(faces) == 0:
        return _NO_TRIANGLES
    least, most = int(faces.min()), int(faces.max())
    if least < 0 or most >= len(vertices):
        wrong = least if least < 0 else most
        return f"a face has vertex {wrong}, of {len(vertices)} vertices"
    is_bad: np.ndarray = ~np.all(np.abs(vertices) <= _LARGEST, axis=1)  # nan too
    used = faces[is_bad[faces].any(axis=1)]
    if len(used) == 0:
        return ""
    vertex = next(int(v) for v in used[0] if is_bad[v])
    place = ", ".join(f"{value:g}" for value in vertices[vertex])
    return f"vertex {vertex} is at ({place}) m"
