import numpy as np
import pytest

from hsslam_node.distance.spread_views import spread_views
from hsslam_node.geometry.se3 import se3_exp


def _views(*groups: tuple[int, float]) -> np.ndarray:
    """For each group, `count` views about `x_m`, a millimetre apart along x: [N, 4, 4]."""
    places = [x_m + 0.001 * k for count, x_m in groups for k in range(count)]
    return np.stack([se3_exp(np.array([x, 0.0, 0, 0, 0, 0])) for x in places])


def test_few_views_are_all_chosen():
    assert spread_views(_views((5, 0.0)), 8, 4).tolist() == [0, 1, 2, 3, 4]


def test_views_of_other_places_go_before_more_views_of_one():
    chosen = spread_views(_views((1, 9.0), (200, 0.0), (1, 5.0), (100, 1.0)), 16, 10)
    assert chosen.tolist() == [0, 200, 201, *range(292, 302)]


def test_the_newest_view_of_a_place_is_the_one_that_is_chosen():
    """What came or went between two visits is as the second one saw it."""
    chosen = spread_views(_views((30, 0.0), (30, 5.0), (30, 0.1), (30, 9.0)), 12, 6)
    assert chosen[chosen < 110].tolist() == [59, 89]


def test_a_camera_that_turns_where_it_stands_looks_at_different_places():
    turned = np.stack([se3_exp(np.array([0, 0, 0, 0, a, 0])) for a in np.linspace(0, 3, 31)])
    chosen = spread_views(np.concatenate([turned, _views((100, 0.0))]), 20, 10)
    looks = turned[chosen[chosen < 31]]
    turns = np.arctan2(looks[:, 0, 2], looks[:, 2, 2])
    assert np.ptp(turns) > 2.2 and np.diff(np.sort(turns)).max() < 0.6


@pytest.mark.parametrize("total", [1, 8, 9, 40])
def test_rows_rise_and_none_is_chosen_twice(total):
    chosen = spread_views(_views((total, 0.0)), 8, 3)
    assert len(chosen) == (total if total <= 8 else 3)  # all others are like these
    assert (np.diff(chosen) > 0).all() and chosen[-1] == total - 1
