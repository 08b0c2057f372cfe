"""A place on one image for every triangle of a mesh: charts, and their packing."""

import math
from typing import NamedTuple

import numpy as np

from hsslam_node.errors import UserError

PADDING_PX = 4  # between charts: bilinear and mipmapped viewers look beyond them
_USED = 0.6  # of the image's pixels are covered by charts, about; the rest lies between them


class Atlas(NamedTuple):
    """A mesh whose vertices have one place on the image each, so it has more of them than before."""

    vertices: np.ndarray  # [N] int64: which vertex of the original each one is
    faces: np.ndarray  # [F, 3] int64, in the original's order
    uv_px: np.ndarray  # [N, 2] float64 px from the upper left corner; pixel centres at halves
    size_px: tuple[int, int]  # width, height


def make_atlas(vertices: np.ndarray, faces: np.ndarray, texel_m: float, most_px: int) -> Atlas:
    """Charts of vertices [V, 3] m and faces [F, 3] by xatlas, on an image of pixels of `texel_m`.

    If the image would be wider or higher than `most_px` its pixels are larger.

    Raises:
        UserError: the package xatlas is not there.
    """
    try:
        import xatlas
    except ImportError:
        raise UserError(
            "--texture: package xatlas is not there: pip install 'hsslam-node[texture]'"
        ) from None
    area = _area(vertices, faces)
    texel_m = max(texel_m, math.sqrt(area / _USED) / most_px)
    packing = xatlas.PackOptions()
    packing.texels_per_unit = 1.0 / texel_m
    packing.padding = PADDING_PX
    packing.bilinear = True
    atlas = xatlas.Atlas()
    atlas.add_mesh(vertices.astype(np.float32), faces.astype(np.uint32))
    atlas.generate(xatlas.ChartOptions(), packing)
    original, faces, uv = atlas[0]
    width, height = atlas.width, atlas.height
    shrink = min(1.0, most_px / max(width, height))
    size = max(math.floor(width * shrink), 1), max(math.floor(height * shrink), 1)
    return Atlas(original.astype(np.int64), faces.astype(np.int64), uv * np.array(size), size)


def _area(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Of all triangles, m²."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
