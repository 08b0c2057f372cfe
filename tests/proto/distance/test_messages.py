"""Grids and distances over the wire, and the blocks of a window put together by a subscriber."""

import numpy as np
import pytest

from hsslam_node.distance.distance_blocks import DistanceBlocks
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.grid_map import GridMap
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_proto import topics
from hsslam_proto.codec import Rejected, decode, encode, encoding_of
from hsslam_proto.distance.arrays import T_world_raster, cells_of, slice_m
from hsslam_proto.distance.assembled import AssembledDistances
from hsslam_proto.distance.compose import Band, Lattice, blocks_message, esdf_message, grid_message
from tests.services.wire_samples import pose

_T_FLOOR_WORLD = se3_exp(np.array([0.3, -0.2, 1.1, 0.5, -0.4, 0.3]))
_BAND = Band(0.15, 1.6, "floor plane")


@pytest.fixture
def grid() -> GridMap:
    """Free cells with a post and an unknown corner."""
    cells = np.zeros((30, 20), np.int8)
    cells[10, 5] = 100
    cells[25:, 15:] = -1
    return GridMap(cells, 0.05, (-0.5, 2.0), _T_FLOOR_WORLD)


def _sent(topic, message):
    back = decode(topic, encode(topic, message), encoding_of(topic))
    assert not isinstance(back, Rejected), back.text
    return back


def test_a_grid_comes_back_at_its_place(grid):
    back = _sent(topics.GRID, grid_message(grid, _BAND, pose(3)))
    np.testing.assert_array_equal(cells_of(back), grid.cells)
    assert (back.index, back.low_m, back.high_m, back.up_by) == (3, *_BAND)
    post = T_world_raster(back) @ [5.5 * 0.05, 10.5 * 0.05, 0, 1]
    on_floor = _T_FLOOR_WORLD @ post
    np.testing.assert_allclose(on_floor[:3], [-0.5 + 5.5 * 0.05, 2.0 + 10.5 * 0.05, 0], atol=1e-6)
    assert grid.cells_at(on_floor[None, :2]).tolist() == [100]


def test_distances_of_the_floor_are_those_to_the_edge_of_the_nearest_occupied_cell(grid):
    back = slice_m(_sent(topics.ESDF, esdf_message(grid, _BAND, pose(3))))
    assert back[10, 5] == 0.0 and np.isnan(back[26, 16])
    assert back[10, 15] == pytest.approx(0.475, abs=1e-3)
    assert back[13, 9] == pytest.approx(0.215, abs=1e-3)


def test_a_grid_of_another_size_is_refused(grid):
    message = grid_message(grid, _BAND, pose(3))
    payload = encode(topics.GRID, message).replace(b"\xa5width\x14", b"\xa5width\x15")
    back = decode(topics.GRID, payload, encoding_of(topics.GRID))
    assert isinstance(back, Rejected) and "cells has 600 bytes: expected 630" in back.text


def _distances(steps: int = 0) -> DistanceMap:
    """A window that moves along x in a world where the distance is x."""
    grid = VoxelGrid(0.05, (-20 + steps, 3, -4), (40, 30, 20))
    x_m = grid.centres(np.indices(grid.shape).reshape(3, -1).T)[:, 0].reshape(grid.shape)
    distance_m = np.asfortranarray(x_m.astype(np.float32))
    distance_m[:, 20:] = np.nan
    states = np.asfortranarray(np.isfinite(distance_m).astype(np.uint8))
    return DistanceMap(grid, distance_m, states, _T_FLOOR_WORLD)


def _message(blocks: DistanceBlocks, distances: DistanceMap, revision: int, series: int = 1):
    changed = blocks.renew(distances)
    lattice = Lattice(distances.grid, distances.T_grid_world, series, revision)
    return _sent(topics.ESDF_BLOCKS, blocks_message(changed, lattice, pose(revision)))


def _expect_whole(assembled: AssembledDistances, distances: DistanceMap) -> None:
    whole = assembled.whole()
    assert whole is not None
    grid, distance_m, T_grid_world = whole
    assert grid == distances.grid
    np.testing.assert_allclose(distance_m, distances.distance_m, atol=6e-4)
    np.testing.assert_allclose(T_grid_world, inverse(inverse(_T_FLOOR_WORLD)), atol=1e-6)


def test_a_subscriber_follows_a_window_that_moves():
    blocks, assembled = DistanceBlocks(), AssembledDistances()
    assert assembled.whole() is None
    for revision, steps in enumerate((0, 0, 7, 40, 400)):
        distances = _distances(steps)
        assembled.add(_message(blocks, distances, revision))
        _expect_whole(assembled, distances)


def test_an_answer_that_comes_late_undoes_nothing():
    blocks, assembled = DistanceBlocks(), AssembledDistances()
    late, newer = _message(blocks, _distances(), 0), _message(blocks, _distances(7), 1)
    assembled.add(newer)
    assembled.add(late)
    _expect_whole(assembled, _distances(7))


def test_a_new_series_begins_anew():
    assembled = AssembledDistances()
    assembled.add(_message(DistanceBlocks(), _distances(400), 9))
    assembled.add(_message(DistanceBlocks(), _distances(), 0, series=2))
    _expect_whole(assembled, _distances())
    assembled.add(_message(DistanceBlocks(), _distances(7), 10))  # of the earlier series
    _expect_whole(assembled, _distances())
