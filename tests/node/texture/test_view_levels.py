"""Levels of views, found from what they show of the same faces."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hsslam_node.texture.view_levels import view_levels


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_levels_are_found_whatever_the_faces_are_like(seed: int):
    rng = np.random.default_rng(seed)
    levels, of_face = rng.normal(size=5), 10 * rng.normal(size=40)
    levels -= levels.mean()
    face, view = np.nonzero(rng.random((40, 5)) < 0.7)
    found = view_levels(face, view, of_face[face] + levels[view], 5)
    np.testing.assert_allclose(found, levels, atol=0.01)


def test_a_view_that_shows_nothing_has_the_level_of_all():
    found = view_levels(np.array([0, 0]), np.array([0, 2]), np.array([1.0, 3.0]), 4)
    np.testing.assert_allclose(found, [-1, 0, 1, 0], atol=1e-6)
    none = np.zeros(0, np.int64)
    np.testing.assert_array_equal(view_levels(none, none, np.zeros(0), 2), [0, 0])
