"""Charts: connected triangles that take their colours from the same keyframe, and their place in it."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import project
from hsslam_node.geometry.se3 import inverse
from hsslam_node.texture.choose_views import NO_VIEW, neighbours

PADDING_PX = 2  # of the image around a chart, for bilinear viewers


class Charts(NamedTuple):
    """Rectangles of keyframes with the triangles that they show; each vertex is in exactly one chart."""

    vertices: np.ndarray  # [N] int64: number of each in the mesh
    faces: np.ndarray  # [f, 3] int64, of these vertices
    chart: np.ndarray  # [N] int64 of each vertex
    uv_px: np.ndarray  # [N, 2] float64 of its keyframe's image, pixel centres at integers
    view: np.ndarray  # [n] int64: the keyframe of each chart
    low: np.ndarray  # [n, 2] int64: first column and row of its rectangle
    size: np.ndarray  # [n, 2] int64: width and height


def cut_charts(
    vertices: np.ndarray,
    faces: np.ndarray,
    view: np.ndarray,
    camera: Camera,
    T_world_cam: np.ndarray,
) -> Charts:
    """Charts of the faces [F, 3] that have a view [F], of vertices [V, 3] m, world.

    T_world_cam is [views, 4, 4].
    """
    beyond = neighbours(faces)
    face, edge = np.nonzero((beyond >= 0) & (view[:, None] == view[beyond]))
    pairs = coo_array((np.ones(len(face)), (face, beyond[face, edge])), (len(faces),) * 2)
    label = connected_components(pairs, directed=False)[1].astype(np.int64)
    seen = view != NO_VIEW
    numbers, first, label = np.unique(label[seen], return_index=True, return_inverse=True)
    of_chart = view[seen][first].astype(np.int64)
    corners = label[:, None] * len(vertices) + faces[seen]  # a vertex in two charts becomes two
    used, corners = np.unique(corners, return_inverse=True)
    chart, vertex = np.divmod(used, len(vertices))
    uv = np.empty((len(used), 2))
    for k in np.unique(of_chart):
        mine = np.flatnonzero(of_chart[chart] == k)
        u, v, _ = project(vertices[vertex[mine]], camera, inverse(T_world_cam[k]))
        uv[mine, 0], uv[mine, 1] = u, v
    low, high = np.full((len(numbers), 2), np.inf), np.full((len(numbers), 2), -np.inf)
    np.minimum.at(low, chart, uv)
    np.maximum.at(high, chart, uv)
    last = np.array([camera.width_px - 1, camera.height_px - 1])
    start = np.maximum(np.floor(low).astype(np.int64) - PADDING_PX, 0)
    end = np.minimum(np.ceil(high).astype(np.int64) + PADDING_PX, last)
    return Charts(vertex, corners.reshape(-1, 3), chart, uv, of_chart, start, end - start + 1)
