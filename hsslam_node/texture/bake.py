"""Colours of the texture's pixels, from one keyframe after the other."""

import numpy as np
from numba import njit

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse
from hsslam_node.texture.atlas import PADDING_PX, Atlas


class Texture:
    """An image that fills; `color` [H, W, 3] uint8 RGB, `has_color` [H, W] bool.

    Args:
        atlas: where each triangle lies.
        vertices: [V, 3] m, world, of the mesh before it was cut.
    """

    def __init__(self, atlas: Atlas, vertices: np.ndarray) -> None:
        width, height = atlas.size_px
        self.color = np.zeros((height, width, 3), np.uint8)
        self.has_color = np.zeros((height, width), np.bool_)
        self._corners = np.ascontiguousarray(vertices, np.float64)[atlas.vertices]
        self._atlas = atlas

    def paint_view(
        self,
        faces: np.ndarray,
        color: np.ndarray,
        gain: np.ndarray,
        camera: Camera,
        T_world_cam: np.ndarray,
    ) -> None:
        """Give triangles [n] the colours of an image [H, W, 3] uint8 RGB, times gains [3]."""
        _paint_view(
            self.color, self.has_color, self._atlas.uv_px, self._corners, self._atlas.faces[faces],
            np.ascontiguousarray(color), gain, np.ascontiguousarray(inverse(T_world_cam), np.float64),
            np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
        )  # fmt: skip

    def paint_vertices(self, faces: np.ndarray, colors: np.ndarray) -> None:
        """Give triangles [n] the colours [V, 3] uint8 RGB of their vertices before the mesh was cut."""
        corners = colors[self._atlas.vertices].astype(np.float64)
        _paint_corners(
            self.color, self.has_color, self._atlas.uv_px, corners, self._atlas.faces[faces]
        )

    def pad(self) -> None:
        """Continue the colours beyond the borders of charts."""
        for _ in range(PADDING_PX):
            _grow(self.color, self.has_color)


@njit(cache=True, nogil=True, error_model="numpy")
def _paint_view(texture, has_color, uv, corners, faces, image, gain, T, intrinsics):
    weights, rgb = np.empty(3), np.empty(3)
    for f in range(len(faces)):
        box = _box(uv, faces[f], has_color.shape)
        for row in range(box[0], box[1]):
            for column in range(box[2], box[3]):
                if not _weigh(uv, faces[f], column + 0.5, row + 0.5, weights):
                    continue
                rgb[:] = 0
                for sample in range(
                    4
                ):  # a pixel of the texture may be larger than one of the image
                    du, dv = 0.25 + 0.5 * (sample & 1), 0.25 + 0.5 * (sample >> 1)
                    _weigh(uv, faces[f], column + du, row + dv, weights)
                    _add_pixel(image, corners, faces[f], weights, T, intrinsics, rgb)
                for a in range(3):
                    texture[row, column, a] = min(rgb[a] / 4 * gain[a] + 0.5, 255.0)
                has_color[row, column] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _paint_corners(texture, has_color, uv, colors, faces):
    weights = np.empty(3)
    for f in range(len(faces)):
        box = _box(uv, faces[f], has_color.shape)
        for row in range(box[0], box[1]):
            for column in range(box[2], box[3]):
                if not _weigh(uv, faces[f], column + 0.5, row + 0.5, weights):
                    continue
                for a in range(3):
                    value = 0.5
                    for corner in range(3):
                        value += weights[corner] * colors[faces[f, corner], a]
                    texture[row, column, a] = min(max(value, 0.0), 255.0)
                has_color[row, column] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _box(uv, face, size):
    """First row, end of rows, first column, end of columns of the pixels of a triangle."""
    a, b, c = uv[face[0]], uv[face[1]], uv[face[2]]
    first_row = max(int(np.floor(min(a[1], b[1], c[1]) - 0.5)), 0)
    end_row = min(int(np.ceil(max(a[1], b[1], c[1]) + 0.5)), size[0])
    first_column = max(int(np.floor(min(a[0], b[0], c[0]) - 0.5)), 0)
    end_column = min(int(np.ceil(max(a[0], b[0], c[0]) + 0.5)), size[1])
    return first_row, end_row, first_column, end_column


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(uv, face, u, v, weights):
    """Barycentric weights of a place on the texture; False beyond the triangle."""
    a, b, c = uv[face[0]], uv[face[1]], uv[face[2]]
    whole = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if whole == 0:
        return False
    weights[1] = ((u - a[0]) * (c[1] - a[1]) - (v - a[1]) * (c[0] - a[0])) / whole
    weights[2] = ((b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0])) / whole
    weights[0] = 1.0 - weights[1] - weights[2]
    return weights.min() >= -1e-9


@njit(cache=True, nogil=True, error_model="numpy")
def _add_pixel(image, corners, face, weights, T, intrinsics, rgb):
    """Add the colour of the image where it shows a place of a triangle."""
    x = y = z = 0.0
    for k in range(3):
        x += weights[k] * corners[face[k], 0]
        y += weights[k] * corners[face[k], 1]
        z += weights[k] * corners[face[k], 2]
    ahead = max(T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3], 1e-3)
    across = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
    down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
    height, width = image.shape[:2]
    u = min(max(across / ahead * intrinsics[0] + intrinsics[2], 0.0), width - 1.001)
    v = min(max(down / ahead * intrinsics[1] + intrinsics[3], 0.0), height - 1.001)
    column, row = int(u), int(v)
    right, low = u - column, v - row
    for a in range(3):
        upper = (1 - right) * image[row, column, a] + right * image[row, column + 1, a]
        lower = (1 - right) * image[row + 1, column, a] + right * image[row + 1, column + 1, a]
        rgb[a] += (1 - low) * upper + low * lower


@njit(cache=True, nogil=True)
def _grow(texture, has_color):
    """Give pixels beside coloured ones the mean of those."""
    height, width = has_color.shape
    before = has_color.copy()
    for row in range(height):
        for column in range(width):
            if before[row, column]:
                continue
            red = green = blue = count = 0
            for v in range(max(row - 1, 0), min(row + 2, height)):
                for u in range(max(column - 1, 0), min(column + 2, width)):
                    if before[v, u]:
                        red += texture[v, u, 0]
                        green += texture[v, u, 1]
                        blue += texture[v, u, 2]
                        count += 1
            if count:
                texture[row, column, 0] = red // count
                texture[row, column, 1] = green // count
                texture[row, column, 2] = blue // count
                has_color[row, column] = True
