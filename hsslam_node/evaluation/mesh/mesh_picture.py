"""A mesh as images: its colours, its shape, its error."""

from functools import cached_property
from typing import Any, Literal

import matplotlib
import numpy as np
import trimesh
from trimesh.visual import TextureVisuals

from hsslam_node.evaluation.mesh.mesh_judge import MeshJudge
from hsslam_node.evaluation.mesh.mesh_metrics import distances
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.view_from_above import looking_down, mean_ahead, mean_up
from hsslam_node.rendering.chunked_mesh import chunked_mesh
from hsslam_node.rendering.depth_render import render_depth

_ABOVE = Camera(720, 560, 620.0, 620.0, 359.5, 279.5)
_AT = 0.35  # place of the inside view among the given ones
_UNSEEN = np.array([0.72, 0.72, 0.72])
_WHITE = np.array([1.0, 1.0, 1.0])
_ELEVATION_RAD = np.deg2rad(62.0)


class MeshPicture:
    """Draws one mesh in the truth's world, with its colours, its shape or its error."""

    def __init__(self, mesh: trimesh.Trimesh, judge: MeshJudge) -> None:
        self._judge = judge
        self._vertices = np.asarray(mesh.vertices, np.float64)
        self._faces = np.ascontiguousarray(mesh.faces, np.int64)
        self._colors = _vertex_colors(mesh)
        self._normals = np.asarray(mesh.face_normals)

    def inside(self, kind: Literal["color", "shape", "error"], worst_m: float = 0.05) -> np.ndarray:
        """As one of the given cameras sees it, RGB [H, W, 3] 0..1."""
        given = self._judge.given
        pose = given.T_world_cam[int(_AT * len(given.T_world_cam))]
        _, face = render_depth(chunked_mesh(self._vertices, self._faces), given.camera, pose)
        if kind == "shape":
            return self._shaded(face, pose, np.full((len(self._vertices), 3), 0.85))
        if kind == "error":
            return self._shaded(face, pose, self._by_error(worst_m))
        return self._shaded(face, pose, self._colors, light=False)

    def from_above(self, worst_m: float) -> np.ndarray:
        """View into the open room at an angle from above, by error, RGB [H, W, 3] 0..1."""
        pose = _pose_above(self._judge.given.T_world_cam, self._vertices)
        towards = self._normals @ pose[:3, 2]
        facing = self._faces[towards < 0.05]  # the ceiling and the near walls look away
        _, face = render_depth(chunked_mesh(self._vertices, facing), _ABOVE, pose)
        numbers = np.flatnonzero(towards < 0.05).astype(np.int32)
        face = np.where(face >= 0, numbers[face], -1) if len(numbers) else face
        return self._shaded(face, pose, self._by_error(worst_m))

    def _shaded(
        self, face: np.ndarray, pose: np.ndarray, colors: np.ndarray, light: bool = True
    ) -> np.ndarray:
        image = np.broadcast_to(_WHITE, (*face.shape, 3)).copy()
        hit = face >= 0
        rows = face[hit]
        value = colors[self._faces[rows]].mean(axis=1)
        if light:
            value = value * (0.45 + 0.55 * np.abs(self._normals[rows] @ pose[:3, 2]))[:, None]
        image[hit] = value
        return np.clip(image, 0, 1)

    def _by_error(self, worst_m: float) -> np.ndarray:
        """Colours [N, 3] of the vertices; grey if no camera saw them."""
        scale = matplotlib.colormaps["turbo"]
        colors = np.asarray(scale(np.clip(self._errors_m / worst_m, 0, 1)))[:, :3]
        return np.where(self._seen[:, None], colors, _UNSEEN)

    @cached_property
    def _errors_m(self) -> np.ndarray:
        surface = self._judge.surface
        return distances(self._vertices, surface.vertices, surface.faces)

    @cached_property
    def _seen(self) -> np.ndarray:
        return self._judge.given.observed(self._vertices)


def _vertex_colors(mesh: trimesh.Trimesh) -> np.ndarray:
    """Colours [N, 3] 0..1 of the vertices, or of the texture there; grey if there are none."""
    visual: Any = mesh.visual
    if isinstance(visual, TextureVisuals):
        visual = visual.to_color()
        visual.mesh = mesh  # for the number of vertices, if there is one colour or none
    colors = np.asarray(visual.vertex_colors)[..., :3] / 255.0
    return np.broadcast_to(colors, (len(mesh.vertices), 3))


def _pose_above(poses: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """T_world_cam [4, 4] of a view from above the middle; up is the cameras' mean up."""
    low, high = np.percentile(vertices, (1, 99), axis=0)
    centre, size = (low + high) / 2, float(np.linalg.norm(high - low))
    pose = np.eye(4)
    pose[:3, :3] = looking_down(mean_up(poses), mean_ahead(poses), _ELEVATION_RAD)
    pose[:3, 3] = centre - 0.85 * size * pose[:3, 2]
    return pose
