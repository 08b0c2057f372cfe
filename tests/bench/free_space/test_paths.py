"""Paths through a gap in a wall: found, not found, and seen to collide if the map is wrong."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hsslam_bench.free_space.distance_errors import measure_from
from hsslam_bench.free_space.paths import RADIUS_M, Level, path, plan_pairs


def _level(gap_m: float) -> Level:
    """4 x 2 m in cells of 5 cm, a wall along y at x = 0 with a gap in its middle; distances are exact."""
    walls = []
    for low, high in ((-5.0, -gap_m / 2), (gap_m / 2, 5.0)):
        corners = np.array([(0, low, -1), (0, high, -1), (0, high, 1), (0, low, 1)], float)
        walls.append(trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False))
    measure = measure_from(trimesh.util.concatenate(walls), np.eye(4))
    x, y = np.meshgrid(np.arange(-2, 2, 0.05), np.arange(-1, 1, 0.05), indexing="ij")
    points = np.stack([x + 0.025, y + 0.025, np.zeros_like(x)], axis=-1)
    true_m = measure(points.reshape(-1, 3)).distance_m.reshape(x.shape)
    return Level(points, true_m.copy(), true_m, measure, np.ones(x.shape, np.bool_))


def test_exact_distances_find_all_paths_through_a_wide_gap_and_none_collides():
    counts = plan_pairs(_level(0.8), 40, 0)
    assert counts.exact == counts.both == counts.found == 40
    assert counts.colliding == 0 and counts.narrowest_m >= RADIUS_M


def test_a_gap_that_is_narrower_than_the_robot_is_closed():
    counts = plan_pairs(_level(0.3), 40, 0)
    assert 10 < counts.exact < 30 and counts.both == counts.exact == counts.found


def test_a_gap_without_room_to_spare_is_closed_to_ours_alone():
    counts = plan_pairs(_level(0.46), 40, 0)
    assert counts.exact == 40 and counts.found < 30


@pytest.mark.parametrize("too_large_m", [0.05, 0.15])
def test_distances_that_are_too_large_collide(too_large_m):
    level = _level(0.3)
    wrong = replace(level, distance_m=level.distance_m + too_large_m)
    counts = plan_pairs(wrong, 40, 0)
    assert (counts.colliding > 0) == (too_large_m > 0.1)


def test_a_path_goes_round_what_was_not_seen():
    level = _level(0.8)
    room_m = level.distance_m.copy()
    room_m[30:50, :20] = -np.inf
    way = path(room_m, np.array([5, 5]), np.array([75, 5]))
    assert way is not None and way[:, 1].max() >= 20
