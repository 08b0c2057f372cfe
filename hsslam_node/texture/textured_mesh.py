"""A mesh with a texture from keyframes: charts, a keyframe for each triangle, colours."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from scipy.spatial import KDTree
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from hsslam_node.dense_map.keyframes import MapKeyframes
from hsslam_node.errors import UserError
from hsslam_node.rendering.chunked_mesh import chunked_mesh
from hsslam_node.texture.atlas import make_atlas
from hsslam_node.texture.bake import Texture
from hsslam_node.texture.choose_views import NO_VIEW, choose_views
from hsslam_node.texture.face_views import FaceViews, views_of_faces

_FACES_PER_M2 = 1500
_TEXEL_M = 0.003  # what a camera of 640 x 480 px resolves from 1.5 m
ColorOf = Callable[[int], np.ndarray]


def textured_mesh(
    mesh: trimesh.Trimesh,
    keyframes: MapKeyframes,
    color_of: ColorOf,
    most_px: int,
    threads: int = 1,
) -> trimesh.Trimesh:
    """The mesh of fewer triangles with a texture, in the same frame.

    Args:
        mesh: with colours of vertices, which triangles have that no keyframe sees.
        keyframes: that the mesh was made of.
        color_of: gives the colour [H, W, 3] uint8 RGB of the k-th of them; it is asked twice.
        most_px: width and height of the texture at most.
        threads: that look at keyframes at once; the texture is the same with any number.

    Raises:
        UserError: a package of the extra `texture` is not there.
    """
    vertices, faces = _simplified(mesh)
    atlas = make_atlas(vertices, faces, _TEXEL_M, most_px)
    camera, poses = keyframes.camera, keyframes.T_world_cam
    chunks = chunked_mesh(vertices, faces)

    def look(k: int) -> FaceViews:
        return views_of_faces(chunks, camera, color_of(k), keyframes.depth_m(k), poses[k])

    texture = Texture(atlas, vertices)
    with ThreadPoolExecutor(threads) as pool:
        chosen = choose_views(faces, list(pool.map(look, range(len(poses)))))
    for k, T in enumerate(poses):
        mine = np.flatnonzero(chosen.view == k)
        if len(mine):
            texture.paint_view(mine, color_of(k), chosen.gain[k], camera, T)
    visual: Any = mesh.visual
    nearest = KDTree(mesh.vertices).query(vertices)[1]
    colors = np.asarray(visual.vertex_colors)[nearest, :3]
    texture.paint_vertices(np.flatnonzero(chosen.view == NO_VIEW), colors)
    texture.pad()
    uv = atlas.uv_px / atlas.size_px
    uv[:, 1] = 1.0 - uv[:, 1]  # trimesh counts from below
    material = PBRMaterial(
        name="texture", baseColorTexture=Image.fromarray(texture.color), metallicFactor=0.0,
        roughnessFactor=1.0,
    )  # fmt: skip
    return trimesh.Trimesh(
        vertices[atlas.vertices], atlas.faces, visual=TextureVisuals(uv, material=material),
        process=False,
    )  # fmt: skip


def _simplified(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [V, 3] float64 m and faces [F, 3] int64 of no more triangles than the texture needs."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    most = max(int(_FACES_PER_M2 * mesh.area), 100)
    if len(faces) <= most:
        return vertices, faces
    try:
        from fast_simplification import simplify
    except ImportError:
        raise UserError(
            "--texture: package fast-simplification is not there: pip install 'hsslam-node[texture]'"
        ) from None
    points, triangles = simplify(
        vertices.astype(np.float32), faces.astype(np.int32), target_count=most
    )
    return points.astype(np.float64), triangles.astype(np.int64)
