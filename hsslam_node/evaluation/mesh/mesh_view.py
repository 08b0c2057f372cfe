"""The colours of a mesh, of its vertices or its texture, as a camera sees them."""

from typing import Any

import cv2
import numpy as np
import trimesh
from trimesh.visual import TextureVisuals

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import pixel_rays
from hsslam_node.geometry.se3 import inverse, transformed
from hsslam_node.rendering.chunked_mesh import chunked_mesh
from hsslam_node.rendering.depth_render import render_depth


class MeshView:
    """Draws a mesh, m in the world, without light."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._mesh = chunked_mesh(mesh.vertices, mesh.faces)
        visual: Any = mesh.visual
        self._texture = None
        if isinstance(visual, TextureVisuals):
            material: Any = visual.material
            image = getattr(material, "baseColorTexture", None) or material.image
            self._texture = np.asarray(image.convert("RGB"))
            size = np.array(self._texture.shape[1::-1])
            uv = np.asarray(visual.uv)
            self._values = np.column_stack([uv[:, 0], 1.0 - uv[:, 1]]) * size - 0.5
        else:
            self._values = np.asarray(visual.vertex_colors)[:, :3] / 255.0

    def draw(self, camera: Camera, T_world_cam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """RGB [H, W, 3] 0..1 and planar depth [H, W] float32 m; black and 0 beside the mesh."""
        depth_m, face = render_depth(self._mesh, camera, T_world_cam)
        row, column = np.nonzero(face >= 0)
        corners = self._mesh.faces[face[row, column]]  # [n, 3]
        a, b, c = (
            transformed(inverse(T_world_cam), self._mesh.vertices[corners[:, k]]) for k in range(3)
        )
        ray = pixel_rays(column, row, camera)
        edges = (np.cross(b, c), np.cross(c, a), np.cross(a, b))
        weights = np.stack([(ray * edge).sum(axis=1) for edge in edges], axis=1)
        weights /= weights.sum(axis=1, keepdims=True)
        values = np.einsum("nk,nkd->nd", weights, self._values[corners])
        image = np.zeros((*face.shape, 3))
        image[row, column] = values if self._texture is None else self._looked_up(values)
        return image, depth_m

    def _looked_up(self, places: np.ndarray) -> np.ndarray:
        """Colours [n, 3] 0..1 at places [n, 2] px of the texture, bilinear."""
        assert self._texture is not None
        u, v = (places[None, :, k].astype(np.float32) for k in range(2))
        rows = -(-u.shape[1] // 32_000)  # cv2.remap takes no wider image
        pad = rows * 32_000 - u.shape[1]
        u, v = (np.pad(x[0], (0, pad)).reshape(rows, -1) for x in (u, v))
        found = cv2.remap(self._texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return found.reshape(-1, 3)[: places.shape[0]] / 255.0
