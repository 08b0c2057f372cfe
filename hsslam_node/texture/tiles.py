"""Small squares of the texture for triangles that no keyframe sees, in the colours of their corners."""

from typing import NamedTuple

import numpy as np

TILE_PX = 4  # 2 x 2 pixels, and one around them
# corners of a triangle, at pixel centres
IN_TILE_PX = np.array([[1.5, 1.5], [2.5, 1.5], [1.5, 2.5]])


class Tiles(NamedTuple):
    """The tiles of n triangles; those of nearly the same colours may share one."""

    colors: np.ndarray  # [m, 3, 3] uint8 RGB, corners of the triangle of each tile
    tile: np.ndarray  # [n] int64, of each triangle

    @classmethod
    def of_each(cls, colors: np.ndarray) -> "Tiles":
        """A tile for each triangle with corners [n, 3, 3] uint8 RGB."""
        return cls(colors, np.arange(len(colors)))

    def shared(self, most: int) -> "Tiles":
        """At most `most` tiles, or 64 if that is more.

        Triangles share a tile if the colours of their corners have the same 5 highest bits. If the tiles are
        still too many, they share one if their mean colours have the same 5, 4, 3 or 2 highest bits. A tile
        has the colours of its first triangle.
        """
        one_color = np.repeat(self.colors.mean(axis=1, keepdims=True).astype(np.uint8), 3, axis=1)
        for colors, bits in ((self.colors, 5), *((one_color, bits) for bits in (5, 4, 3, 2))):
            levels = (colors >> (8 - bits)).reshape(-1, 9).astype(np.int64)
            _, first, kind = np.unique(
                levels @ (1 << bits * np.arange(9)), return_index=True, return_inverse=True
            )
            if len(first) <= most:
                break
        return Tiles(colors[first], kind[self.tile])

    def paint(self, texture: np.ndarray, places: np.ndarray) -> None:
        """Paint the tiles at places [m, 2] px, with bilinear colours between the corners of triangles."""
        a, b, c = self.colors.astype(np.int64).swapaxes(0, 1)
        block = np.stack([np.stack([a, b], 1), np.stack([c, np.clip(b + c - a, 0, 255)], 1)], 1)
        whole = np.pad(block, ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")  # [m, 4, 4, 3]
        step = np.arange(TILE_PX)
        rows, columns = places[:, 1, None, None] + step[:, None], places[:, 0, None, None] + step
        texture[rows, columns] = whole
