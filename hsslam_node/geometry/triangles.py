"""Whether the vertices and faces of a mesh fit together; apart from the readers, which share it."""

import numpy as np

NO_TRIANGLES = "holds no triangles"
_LARGEST = 1e8  # m, of a coordinate


def problem_of_triangles(vertices: np.ndarray, faces: np.ndarray) -> str:
    """What is wrong with triangles `faces` [F, 3] between `vertices` [V, 3] m; empty if nothing is.

    Vertices that no face uses may be anything.
    """
    if len(faces) == 0:
        return NO_TRIANGLES
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
