"""Small squares of the texture for triangles that no keyframe sees, in the colours of their corners."""

from typing import NamedTuple

import numpy as np

TILE_PX = 4  # 2 x 2 pixels, and one around them
IN_TILE_PX = np.array(
    [[1.5, 1.5], [2.5, 1.5], [1.5, 2.5]]
)  # the corners of a triangle, at pixel centres


class Tiles(NamedTuple):
    """The tiles of n triangles; those of nearly the same colours may share one."""

    colors: np.ndarray  # [m, 3, 3] uint8 RGB, corners of the triangle of each tile
    tile: np.ndarray  # [n] int64, of each triangle

    @classmethod
    def of_each(cls, colors: np.ndarray) -> "Tiles":
        """A tile for each triangle with corners [n, 3, 3] uint8 RGB."""
        return cls(colors, np.arange(len(colors)))

    def shared(self, most: int) -> "Tiles":
        """At most so many tiles, or 64: corners are told apart by 5 bits a colour, or if that is not enough
        triangles have one colour, of 5 bits or fewer. The first triangle of each kind gives the colours."""
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
        """Paint them at places [m, 2] px: bilinear colours between corners are those of the triangles."""
        a, b, c = self.colors.astype(np.int64).swapaxes(0, 1)
        block = np.stack([np.stack([a, b], 1), np.stack([c, np.clip(b + c - a, 0, 255)], 1)], 1)
        whole = np.pad(block, ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")  # [m, 4, 4, 3]
        step = np.arange(TILE_PX)
        rows, columns = places[:, 1, None, None] + step[:, None], places[:, 0, None, None] + step
        texture[rows, columns] = whole
