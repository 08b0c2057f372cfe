"""Triangles of nearly the same colours share a tile."""

import numpy as np
import pytest

from hsslam_node.texture.tiles import TILE_PX, Tiles


@pytest.mark.parametrize("most", [64, 500, 4000])
def test_there_are_at_most_so_many_tiles_as_asked_for(most: int):
    colors = np.random.default_rng(0).integers(0, 256, (5000, 3, 3), np.uint8)
    shared = Tiles.of_each(colors).shared(most)
    assert len(shared.colors) <= most and shared.tile.shape == (5000,)
    off = shared.colors.astype(int)[shared.tile].mean(axis=1) - colors.mean(axis=1)
    assert np.abs(off).max() <= 64  # 2 bits a colour


def test_grey_triangles_share_tiles_of_nearly_their_grey():
    rng = np.random.default_rng(0)
    colors = rng.integers(0, 252, (5000, 1, 1)) + rng.integers(0, 4, (5000, 3, 3))
    shared = Tiles.of_each(colors.astype(np.uint8)).shared(500)
    assert len(shared.colors) <= 500
    off = shared.colors.astype(int)[shared.tile].mean(axis=1) - colors.mean(axis=1)
    assert np.abs(off).max() <= 8  # 5 bits


def test_equal_triangles_keep_their_colours_in_one_tile():
    corners = np.array([[10, 20, 30], [200, 100, 0], [255, 255, 255]], np.uint8)
    shared = Tiles.of_each(np.stack([corners] * 7)).shared(3)
    np.testing.assert_array_equal(shared.colors, [corners])
    texture = np.zeros((TILE_PX, TILE_PX, 3), np.uint8)
    shared.paint(texture, np.array([[0, 0]]))
    np.testing.assert_array_equal(texture[[1, 1, 2], [1, 2, 1]], corners)
