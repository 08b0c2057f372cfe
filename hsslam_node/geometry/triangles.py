"""Reads meshes whose faces and vertices fit together: of runs, of users, of ground truth."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hsslam_node.errors import UserError, one_line

if TYPE_CHECKING:
    import trimesh

_NO_TRIANGLES = "holds no triangles"
_LARGEST = 1e8  # m, of a coordinate


def triangle_mesh(path: Path, expected: str) -> "trimesh.Trimesh":
    """The triangles of a file as they are; vertices that no face uses may be anything.

    Raises:
        UserError: the file is damaged, it has no triangles, or a vertex of a face is missing, not finite or
            too far away; ends with `expected`.
    """
    import trimesh  # takes its time, and only the evaluator needs it

    try:
        loaded: object = trimesh.load(str(path), process=False)
        if isinstance(loaded, trimesh.Scene):
            for one in loaded.geometry.values():
                _restore_colors(one)
            loaded = loaded.to_mesh()
    except Exception as error:  # trimesh's readers raise errors of many types
        raise UserError(f"{path}: damaged mesh: {one_line(error)}: {expected}") from None
    if not isinstance(loaded, trimesh.Trimesh):
        raise UserError(f"{path}: {_NO_TRIANGLES}: {expected}")
    if problem := _problem(loaded.vertices, loaded.faces):
        raise UserError(f"{path}: {problem}: {expected}")
    return loaded


def _restore_colors(mesh: Any) -> None:
    """Give vertices their colours, which trimesh keeps apart if a glTF has a material without a texture."""
    from trimesh.visual import ColorVisuals, TextureVisuals

    visual = getattr(mesh, "visual", None)
    if not isinstance(visual, TextureVisuals) or visual.uv is not None:
        return
    colors = visual.vertex_attributes.get("color")
    if colors is not None:
        mesh.visual = ColorVisuals(mesh, vertex_colors=colors)


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
