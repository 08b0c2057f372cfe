"""Textures a mesh from keyframes: one keyframe for each triangle, charts, one image.

A chart is the part of a keyframe that shows connected triangles. Its pixels are copied, without unwrapping.
Source: Waechter, Moehrle and Goesele, Let There Be Color! Large-Scale Texturing of 3D Reconstructions, 2014
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from hsslam_node.dense_map.keyframes import MapKeyframes
from hsslam_node.errors import UserError
from hsslam_node.rendering.chunked_mesh import chunked_mesh
from hsslam_node.texture.charts import cut_charts
from hsslam_node.texture.choose_views import NO_VIEW, choose_views
from hsslam_node.texture.face_views import FaceViews, views_of_faces
from hsslam_node.texture.packing import pack
from hsslam_node.texture.tiles import IN_TILE_PX, TILE_PX, Tiles

_SMALLER = 0.9
_LEAST_SCALE = 0.1  # of charts: less is no texture
_LEAST_KEYFRAMES = 5  # that show which pixels never have depth
_WITH_TILES = 1.5  # width of an image, times that of charts that take half of it, with some waste
ColorOf = Callable[[int], np.ndarray]


def textured_mesh(
    mesh: trimesh.Trimesh,
    keyframes: MapKeyframes,
    color_of: ColorOf,
    most_px: int,
    threads: int = 1,
) -> trimesh.Trimesh:
    """Returns the same triangles with a texture, and duplicates vertices at the borders of charts.

    Args:
        mesh: with vertex colours, for triangles that no keyframe sees. Triangles should be small compared
            with their distance from the cameras, as those of marching cubes are.
        keyframes: of the mesh.
        color_of: gives the colour [H, W, 3] uint8 RGB of keyframe k; called twice.
        most_px: largest width and height of the texture. To fit, charts shrink, and triangles of nearly the
            same colours that no keyframe sees share pixels.
        threads: that process keyframes in parallel; the texture does not depend on it.

    Raises:
        UserError: charts do not fit into the texture even at a tenth of their size.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    camera, poses = keyframes.camera, keyframes.T_world_cam
    chunks = chunked_mesh(vertices, faces)

    def look(k: int) -> FaceViews:
        return views_of_faces(chunks, camera, color_of(k), keyframes.depth_m(k), poses[k], hidden)

    with ThreadPoolExecutor(threads) as pool:
        hidden = _without_depth(keyframes, pool)
        view, gain = choose_views(faces, list(pool.map(look, range(len(poses)))))
    charts = cut_charts(vertices, faces, view, camera, poses)
    unseen = faces[view == NO_VIEW]
    visual: Any = mesh.visual
    tiles = Tiles.of_each(np.asarray(visual.vertex_colors)[unseen, :3])
    sizes, places, (width, height), tiles = _packed(charts.size, tiles, most_px)
    texture = np.zeros((height, width, 3), np.uint8)
    for k in np.unique(charts.view):
        image = _brightened(color_of(int(k)), gain[k])
        for i in np.flatnonzero(charts.view == k):
            _paste(texture, image, charts.low[i], charts.size[i], places[i], sizes[i])
    of_tile = places[len(charts.size) :]
    tiles.paint(texture, of_tile)
    scale = sizes[: len(charts.size)] / charts.size
    uv_px = (charts.uv_px + 0.5 - charts.low[charts.chart]) * scale[charts.chart]
    in_tile = of_tile[tiles.tile, None] + IN_TILE_PX  # [n, 3, 2]
    uv_px = np.concatenate([uv_px + places[charts.chart], in_tile.reshape(-1, 2)])
    uv = uv_px / (width, height)
    uv[:, 1] = 1.0 - uv[:, 1]  # trimesh counts from below
    image = Image.fromarray(texture)
    material = PBRMaterial(
        name="texture", baseColorTexture=image, metallicFactor=0.0, roughnessFactor=1.0,
        doubleSided=True,
        baseColorFactor=[255, 255, 255, 255],  # else the material of an .obj darkens the image
    )  # fmt: skip
    more = len(charts.vertices) + np.arange(unseen.size).reshape(-1, 3)
    return trimesh.Trimesh(
        vertices[np.concatenate([charts.vertices, unseen.ravel()])],
        np.concatenate([charts.faces, more]),
        visual=TextureVisuals(uv, material=material),
        process=False,
    )


def _packed(
    charts: np.ndarray, tiles: Tiles, most_px: int
) -> tuple[np.ndarray, np.ndarray, tuple[int, int], Tiles]:
    """Sizes and places, [n, 2] int64 px, of charts [m, 2] and then of tiles, the image's size, and the tiles.

    If they do not fit, triangles share tiles if tiles take more than half of the image, and charts shrink.
    """
    most_tiles = most_px**2 // (2 * TILE_PX**2)
    scale, are_shared = 1.0, False
    while True:
        squares = np.full((len(tiles.colors), 2), TILE_PX, np.int64)
        sizes = np.concatenate([_scaled(charts, scale), squares])
        places, size = pack(sizes)
        if max(size) <= most_px:
            return sizes, places, size, tiles
        if len(squares) > most_tiles and not are_shared:
            tiles, are_shared = tiles.shared(most_tiles), True
        elif scale > _LEAST_SCALE:
            scale = max(_LEAST_SCALE, scale * min(_SMALLER, most_px / max(size)))
        else:
            _, size = pack(_scaled(charts, scale))
            needed = math.ceil(_WITH_TILES * max(size))
            raise UserError(
                f"--texture-px {most_px}: {len(charts)} parts of keyframes do not fit at a tenth of their "
                f"size: expected {needed} or more, or a coarser --voxel"
            )


def _scaled(charts: np.ndarray, scale: float) -> np.ndarray:
    """Sizes [m, 2] int64 px of charts, 1 px at least."""
    return np.maximum((scale * charts).astype(np.int64), 1)


def _brightened(image: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """The image [H, W, 3] uint8 times a gain [3] for each colour."""
    table = np.clip(np.arange(256)[:, None] * gain + 0.5, 0, 255).astype(np.uint8)
    return cv2.LUT(image, table[None])


def _without_depth(keyframes: MapKeyframes, pool: ThreadPoolExecutor) -> np.ndarray:
    """Pixels [H, W] bool that have no depth in any keyframe: `--mask` leaves out what they show."""
    hidden = np.full((keyframes.camera.height_px, keyframes.camera.width_px), True)
    if len(keyframes) < _LEAST_KEYFRAMES:
        return ~hidden
    for has_depth in pool.map(lambda k: keyframes.depth_m(k) > 0, range(len(keyframes))):
        hidden &= ~has_depth
    return hidden


def _paste(
    texture: np.ndarray,
    image: np.ndarray,
    low: np.ndarray,
    size: np.ndarray,
    place: np.ndarray,
    new_size: np.ndarray,
) -> None:
    """Copy a rectangle of the image into the texture, resized to its new size."""
    part = image[low[1] : low[1] + size[1], low[0] : low[0] + size[0]]
    if (new_size != size).any():
        part = cv2.resize(part, (int(new_size[0]), int(new_size[1])), interpolation=cv2.INTER_AREA)
    texture[place[1] : place[1] + new_size[1], place[0] : place[0] + new_size[0]] = part
