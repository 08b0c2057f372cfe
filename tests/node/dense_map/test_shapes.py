"""Distances to spheres and boxes, and the cubes around them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.dense_map.shapes import Boxes, Spheres, rigid_transform
from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import se3_exp

twists = st.tuples(*[st.floats(-2, 2)] * 6)
sizes = st.tuples(*[st.floats(0.05, 2)] * 3)


@given(twists, sizes, st.integers(0, 1000))
def test_points_of_a_box_are_within_it_and_its_cube(twist, size_m, seed):
    T = se3_exp(np.array(twist))
    box = Boxes(T[None], np.array(size_m))
    local = np.random.default_rng(seed).uniform(-0.75, 0.75, (50, 3)) * size_m
    points = local @ T[:3, :3].T + T[:3, 3]
    distance_m = box.distance_m(points, np.zeros(50, int))
    beyond = np.abs(local) - np.array(size_m) / 2
    np.testing.assert_array_equal(distance_m <= 0, (beyond <= 0).all(axis=1))
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    np.testing.assert_allclose(np.maximum(distance_m, 0), outside, atol=1e-9)
    centres, half = box.around()
    within = points[distance_m <= 0]
    assert (np.abs(within - centres[0]) <= half[0] + 1e-9).all()


@given(twists, sizes)
def test_probes_are_within_the_body_and_reach_its_ends(twist, size_m):
    boxes = Boxes(np.tile(se3_exp(np.array(twist)), (2, 1, 1)), np.array(size_m))
    spheres = Spheres(boxes.T_world_box[:, :3, 3], size_m[0])
    for bodies, reach_m in ((boxes, min(size_m) / 2), (spheres, size_m[0])):
        probes = bodies.probes(np.array([1]))[0]
        depth_m = bodies.distance_m(probes, np.ones(len(probes), int))
        assert (depth_m < 0).all() and depth_m.max() > -0.03 * reach_m


def test_a_box_between_corners_is_that_box():
    box = Boxes.between(np.array([[0, 0, 0], [1, 1, 1]]), np.array([[1, 2, 3], [2, 2, 4]]))
    points = np.array([[0.5, 1, 1.5], [-1, 1, 1.5], [1.5, 1.5, 5.0]])
    np.testing.assert_allclose(box.distance_m(points, np.array([0, 0, 1])), [-0.5, 1.0, 1.0])


def test_a_sphere_has_one_radius_or_each_its_own():
    centres = np.array([[0.0, 0, 0], [1, 0, 0]])
    points, of = np.zeros((2, 3)), np.arange(2)
    np.testing.assert_allclose(Spheres(centres, 0.2).distance_m(points, of), [-0.2, 0.8])
    each = Spheres(centres, np.array([0.2, 0.5]))
    np.testing.assert_allclose(each.distance_m(points, of), [-0.2, 0.5])


_FAR = np.eye(4) + 1e12 * np.eye(4, k=3)  # a pose


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Spheres(np.zeros((2, 2)), 0.1), r"centres \[\[0.0, 0.0\], .*finite .*\[N, 3\]"),
        (lambda: Spheres(np.full((1, 3), np.nan), 0.1), "centres .*nan"),
        (lambda: Spheres(np.ma.masked_equal(np.eye(3), 0), 0.1), "centres: has masked values: exp"),
        (lambda: Spheres(np.zeros((2, 3)), 0.0), "radius_m 0.0: expected metres above 0"),
        (lambda: Spheres(np.zeros((2, 3)), np.ones(3)), "radius_m"),
        (lambda: Boxes(np.eye(4), np.ones(3)), "T_world_box .*expected finite transforms"),
        (lambda: Boxes(np.eye(4)[None], np.zeros(3)), "size_m .*expected metres above 0"),
        (lambda: Spheres(np.zeros((1, 3)), np.inf), "radius_m inf: expected .* at most 1e.06"),
        (lambda: Spheres(np.zeros((1, 3)), 1e200), "radius_m 1e.200: expected"),
        (lambda: Boxes(np.eye(4)[None], np.array([1, np.inf, 1])), "size_m .*inf.*at most 1e.06"),
        (lambda: Boxes.between([[-1e200] * 3], [[1e200] * 3]), "size_m .*e.200"),
        (lambda: Boxes.between(np.ones((1, 3)), np.zeros((1, 3))), "size_m"),
        (
            lambda: Boxes.between(np.zeros((1, 3)), np.ones((2, 3))),
            r"high \[2, 3\]: expected \[1, 3\]",
        ),
        (lambda: Boxes(np.zeros((1, 4, 4)), np.ones(3)), "T_world_box .*of a rotation and a tra"),
        (lambda: Boxes(np.diag([2.0, 2, 2, 1])[None], np.ones(3)), "T_world_box .*of a rotation"),
        (lambda: Boxes(np.diag([1.0, 1, -1, 1])[None], np.ones(3)), "T_world_box .*of a rotation"),
        (
            lambda: rigid_transform("T", _FAR),
            r"T \[\[1.0, .*0000.0\], .*translation of at most 1e\+06 m",
        ),
    ],
)
def test_what_is_no_shape_is_refused_in_one_line(make, text):
    with pytest.raises(UserError, match=text) as refused:
        make()
    assert "\n" not in str(refused.value)
