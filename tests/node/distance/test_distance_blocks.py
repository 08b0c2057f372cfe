"""Blocks of distances: those that change are given out, and together they are the distances."""

import numpy as np
import pytest

from hsslam_node.distance.distance_blocks import Blocks, DistanceBlocks
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.states import BLOCK_SIDE, NOT_KNOWN_MM
from hsslam_node.distance.voxel_grid import VoxelGrid

_SHAPE = (40, 33, 20)


def _distances(grid: VoxelGrid, seed: int = 0) -> DistanceMap:
    """Of every voxel of the lattice its own; a tenth is not known."""
    x, y, z = np.meshgrid(
        *(np.arange(n) + f for n, f in zip(grid.shape, grid.first, strict=True)), indexing="ij"
    )
    distance_m = ((31 * x + 17 * y + 7 * z + seed) % 200) / 100.0 - 0.5
    distance_m[(x + 3 * y + z) % 10 == 0] = np.nan
    distance_m = np.asfortranarray(distance_m.astype(np.float32))
    states = np.asfortranarray(np.isfinite(distance_m).astype(np.uint8))
    return DistanceMap(grid, distance_m, states)


def _put(blocks: Blocks, into: dict[tuple[int, ...], np.ndarray]) -> None:
    into.update(
        {
            tuple(place): mm
            for place, mm in zip(blocks.places.tolist(), blocks.distance_mm, strict=True)
        }
    )


def _at(found: dict[tuple[int, ...], np.ndarray], voxel: np.ndarray) -> int:
    block, (i, j, k) = voxel // BLOCK_SIDE, voxel % BLOCK_SIDE
    return int(found[tuple(block.tolist())][k, j, i])


def _expect(found: dict[tuple[int, ...], np.ndarray], distances: DistanceMap) -> None:
    rng = np.random.default_rng(0)
    for index in rng.integers(0, _SHAPE, (300, 3)):
        metres = distances.distance_m[tuple(index)]
        mm = NOT_KNOWN_MM if np.isnan(metres) else round(1000 * float(metres))
        assert abs(_at(found, index + distances.grid.first) - mm) <= 1


@pytest.mark.parametrize("first", [(0, 0, 0), (-5, 7, -20), (16, -16, 3)])
def test_together_they_are_the_distances(first):
    blocks, found = DistanceBlocks(), {}
    distances = _distances(VoxelGrid(0.05, first, _SHAPE))
    _put(blocks.renew(distances), found)
    _expect(found, distances)
    again = blocks.known()
    assert {tuple(p) for p in again.places.tolist()} == set(found)


def test_what_stays_is_not_given_out_again():
    blocks, grid = DistanceBlocks(), VoxelGrid(0.05, (0, 0, 0), _SHAPE)
    first = _distances(grid)
    assert len(blocks.renew(first).places) == 3 * 3 * 2
    assert len(blocks.renew(first).places) == 0
    nearly = first.distance_m.copy(order="F") + np.float32(0.004)
    assert len(blocks.renew(DistanceMap(grid, nearly, first.states)).places) == 0
    changed = first.distance_m.copy(order="F")
    changed[20, 5, 18] += 0.02
    renewed = blocks.renew(DistanceMap(grid, changed, first.states))
    assert renewed.places.tolist() == [[1, 0, 1]]


def test_small_changes_add_up():
    """What subscribers have is never off by more than the tolerance."""
    blocks, grid, found = DistanceBlocks(), VoxelGrid(0.05, (0, 0, 0), _SHAPE), {}
    first = _distances(grid)
    _put(blocks.renew(first), found)
    for step in range(1, 8):
        now = first.distance_m.copy(order="F") + np.float32(0.002 * step)
        _put(blocks.renew(DistanceMap(grid, now, first.states)), found)
        known = np.argwhere(np.isfinite(now))[::97]
        off = [abs(_at(found, index) - 1000 * now[tuple(index)]) for index in known]
        assert max(off) <= 6


def test_a_voxel_that_becomes_unknown_is_given_out():
    blocks, grid = DistanceBlocks(), VoxelGrid(0.05, (0, 0, 0), _SHAPE)
    first = _distances(grid)
    blocks.renew(first)
    changed = first.distance_m.copy(order="F")
    changed[2, 3, 4] = np.nan
    renewed = blocks.renew(DistanceMap(grid, changed, first.states))
    assert (
        renewed.places.tolist() == [[0, 0, 0]] and renewed.distance_mm[0, 4, 3, 2] == NOT_KNOWN_MM
    )


@pytest.mark.parametrize("steps", [(3, 0, 0), (-25, 16, 0), (100, 0, 0)])
def test_a_window_that_moves_gives_out_what_is_new(steps):
    blocks, found = DistanceBlocks(), {}
    before = _distances(VoxelGrid(0.05, (0, 0, 0), _SHAPE))
    _put(blocks.renew(before), found)
    after = _distances(before.grid.moved(np.array(steps)))
    renewed = blocks.renew(after)
    _put(renewed, found)
    _expect(found, after)
    low, high = np.array(steps), np.array(steps) + _SHAPE
    inside = (BLOCK_SIDE * renewed.places >= np.maximum(low, 0)) & (
        BLOCK_SIDE * (renewed.places + 1) <= np.minimum(high, _SHAPE)
    )
    assert not inside.all(axis=1).any()  # blocks that both windows hold whole stay


def test_what_is_no_longer_known_is_given_out():
    """Only a corner is known now: the other blocks have lost all that they knew."""
    blocks, grid, found = DistanceBlocks(), VoxelGrid(0.05, (3, 0, -2), _SHAPE), {}
    first = _distances(grid)
    _put(blocks.renew(first), found)
    corner = np.zeros(_SHAPE, bool, order="F")
    corner[:5, :5, :5] = True
    distance_m = np.where(corner, first.distance_m, np.float32(np.nan))
    now = DistanceMap(grid, np.asfortranarray(distance_m), np.where(corner, first.states, 0))
    _put(blocks.renew(now), found)
    _expect(found, now)
    nothing = np.full(_SHAPE, np.nan, np.float32, order="F")
    last = DistanceMap(grid, nothing, np.zeros(_SHAPE, np.uint8))
    _put(blocks.renew(last), found)
    _expect(found, last)
    assert len(blocks.known().places) == 0
