"""Bodies in an analytic room: free where, and only where, no surface is in them."""

import numpy as np
import pytest

from hsslam_node.dense_map.free_space import are_free
from hsslam_node.dense_map.shapes import Boxes, Spheres
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.se3 import se3_exp

ROOM = Bound((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
BALL_M = 0.3  # about the origin
_TOLD_M = 0.036  # farther away a map says no more than this
_SLACK_M = 0.0109


def _distance_m(points: np.ndarray) -> np.ndarray:
    return np.minimum(np.linalg.norm(points, axis=1) - BALL_M, _TOLD_M)


def _ask(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All of the room was seen but what lies beyond x = 0.8."""
    known = ROOM.contains(points) & (points[:, 0] < 0.8)
    return _distance_m(points), known


def test_a_sphere_is_free_if_the_surface_is_farther_than_its_radius():
    rng = np.random.default_rng(0)
    centres = rng.uniform(-0.7, 0.55, (600, 3))
    radii = rng.uniform(0.01, 0.2, 600)
    free = are_free(Spheres(centres, radii), _ask)
    gap_m = np.linalg.norm(centres, axis=1) - BALL_M - radii
    known = centres[:, 0] + radii < 0.8 - _SLACK_M
    assert free[(gap_m > _SLACK_M) & known].all()
    assert not free[gap_m <= 0].any()  # inside the ball, too
    assert 100 < free.sum() < 580


def test_a_body_that_reaches_into_the_unseen_is_not_free():
    x = np.array([0.6, 0.69, 0.72, 0.75, 0.9, 5.0])
    centres = np.stack([x, np.full(6, -0.6), np.full(6, 0.5)], axis=1)
    free = are_free(Spheres(centres, 0.1), _ask)
    assert free[:1].all() and not free[2:].any()


def test_a_box_is_free_however_it_is_turned():
    rng = np.random.default_rng(1)
    twists = rng.uniform(-1, 1, (200, 6)) * [0.5, 0.5, 0.5, 2.0, 2.0, 2.0]
    T = np.stack([se3_exp(twist) for twist in twists])
    T[:, :3, 3] = twists[:, :3]
    boxes = Boxes(T, np.array([0.1, 0.3, 0.2]))
    free = are_free(boxes, _ask)
    gap_m = boxes.distance_m(np.zeros((200, 3)), np.arange(200)) - BALL_M
    assert free[gap_m > _SLACK_M].all() and not free[gap_m <= 0].any()
    assert 20 < free.sum() < 180


def test_the_largest_bodies_are_not_free():
    inside = np.array([[0.0, 0.0, -0.6]])
    assert not are_free(Spheres(inside, 1e6), _ask).any()
    assert not are_free(Boxes.between(inside - 5e5, inside + 5e5), _ask).any()


@pytest.mark.parametrize("size_m", [(1e6, 1e-3, 1e-3), (10.0, 10.0, 1e-3), (1e-3, 5.0, 3.0)])
def test_a_long_thin_body_that_leaves_the_seen_space_is_looked_at_only_at_a_few_points(size_m):
    asked = []

    def ask(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        asked.append(len(points))
        return _ask(points)

    T = np.eye(4)
    T[2, 3] = -0.6
    assert not are_free(Boxes(T[None], np.array(size_m)), ask).any()
    assert sum(asked) == 27


def test_many_large_bodies_take_no_more_memory_than_a_few():
    """A cubic metre each, in free space that keyframes saw everywhere."""
    asked = []

    def ask(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        asked.append(len(points))
        return np.full(len(points), 2.0), np.ones(len(points), np.bool_)

    corners = np.linspace(-9.0, 9.0, 100)[:, None] * np.ones(3)
    assert are_free(Boxes.between(corners, corners + 1.0), ask).all()
    assert max(asked) < 400_000


def test_a_body_of_which_no_distance_is_known_is_not_free():
    class Nowhere(Spheres):
        def distance_m(self, points, of):
            return np.full(len(points), np.nan)

    assert not are_free(Nowhere(np.array([[0.0, 0.0, 0.0]]), 0.1), _ask).any()


def test_no_bodies_are_no_answer():
    assert are_free(Spheres(np.zeros((0, 3)), 0.1), _ask).shape == (0,)
