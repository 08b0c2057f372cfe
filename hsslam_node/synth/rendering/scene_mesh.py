"""The surface of the scene as triangles."""

import numpy as np
import trimesh

from hsslam_node.synth.parts.primitive import Kind, Primitive

_CELL_M = 0.05
_ROUND_SEGMENTS = 48  # 1.1 mm sagitta on the 0.5 m shapes, less on smaller ones


def scene_mesh(parts: list[Primitive]) -> trimesh.Trimesh:
    """All faces as grids of at most 5 cm, world frame, m; also those hidden inside others."""
    vertices, faces, offset = [], [], 0
    for part in parts:
        for face in range(part.face_count):
            columns, rows = _cells(part, face)
            if part.kind == Kind.CYLINDER and face > 0:
                points, triangles = _disc(part, face)
            else:
                u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
                points = part.surface(face, u, v)[0].reshape(-1, 3)
                triangles = _grid_triangles(columns, rows)
            vertices.append(points)
            faces.append(triangles + offset)
            offset += len(points)
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)


def _cells(part: Primitive, face: int) -> tuple[int, int]:
    width_m, height_m = part.face_size_m(face)
    columns, rows = int(np.ceil(width_m / _CELL_M)), int(np.ceil(height_m / _CELL_M))
    if part.kind in (Kind.CYLINDER, Kind.ELLIPSOID):
        columns = max(columns, _ROUND_SEGMENTS)
    if part.kind == Kind.ELLIPSOID:
        rows = max(rows, _ROUND_SEGMENTS // 2)
    return max(columns, 1), max(rows, 1)


def _grid_triangles(columns: int, rows: int) -> np.ndarray:
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = corner + columns + 1
    upper = np.column_stack([corner, below, corner + 1])
    return np.concatenate([upper, np.column_stack([corner + 1, below, below + 1])])


def _disc(part: Primitive, face: int) -> tuple[np.ndarray, np.ndarray]:
    angle = np.arange(_ROUND_SEGMENTS) * (2 * np.pi / _ROUND_SEGMENTS)
    u = np.concatenate([[0.5], 0.5 + 0.5 * np.cos(angle)])
    v = np.concatenate([[0.5], 0.5 - 0.5 * np.sin(angle)])
    k = np.arange(_ROUND_SEGMENTS)
    triangles = np.column_stack([np.zeros_like(k), k + 1, (k + 1) % _ROUND_SEGMENTS + 1])
    return part.surface(face, u, v)[0], triangles
