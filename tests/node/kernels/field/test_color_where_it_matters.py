"""Colour is computed for some points only: theirs is exact, the others are grey and have no gradient."""

import numpy as np
import pytest

from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.backward import field_backward
from hsslam_node.kernels.field.forward import color_forward, field_forward, geometry_forward
from hsslam_node.kernels.field.gradient import gradient
from hsslam_node.kernels.mapping.rendering import render_forward, samples_with_color

N = 700


@pytest.fixture(scope="module")
def rows() -> np.ndarray:
    return np.flatnonzero(np.random.default_rng(0).random(N) < 0.4)


def _forward(field, rows):
    points = field.points(N, seed=4, reach=1.2)
    acts = field_activations(field.kernel, N)
    geometry_forward(field.params, field.kernel, points, N, acts)
    acts.color_row[: len(rows)] = rows
    color_forward(field.params, field.kernel, N, len(rows), acts)
    return points, acts


def test_chosen_points_have_their_colour_and_others_are_grey(field, rows):
    points, acts = _forward(field, rows)
    whole = field_activations(field.kernel, N)
    field_forward(field.params, field.kernel, points, N, whole)
    np.testing.assert_array_equal(acts.sdf, whole.sdf)
    np.testing.assert_allclose(acts.rgb[rows], whole.rgb[rows], atol=1e-6)
    assert (np.delete(acts.rgb, rows, axis=0) == 0.5).all()


def test_gradient_is_that_of_no_colour_elsewhere(field, rows, close):
    rng = np.random.default_rng(1)
    d_sdf = rng.normal(size=N).astype(np.float32)
    d_rgb = rng.normal(size=(N, 3)).astype(np.float32)
    points, acts = _forward(field, rows)
    whole = field_activations(field.kernel, N)
    field_forward(field.params, field.kernel, points, N, whole)
    there = np.zeros_like(d_rgb)
    there[rows] = d_rgb[rows]
    found = []
    for state, upstream in ((acts, d_rgb), (whole, there)):
        grad, d_points = gradient(field.kernel), np.full((N, 3), np.nan, np.float32)
        field_backward(field.params, field.kernel, N, state, d_sdf, upstream, grad, d_points, True)
        found.append((grad.values, d_points))
    close(found[0][0], found[1][0], 1e-5)
    close(found[0][1], found[1][1], 1e-5)


def test_rendered_colour_changes_by_no_more_than_its_bound():
    rng = np.random.default_rng(2)
    R, S, least = 200, 12, np.float32(0.01)
    sdf, z = rng.uniform(-1, 1, (R, S)).astype(np.float32), np.ones((R, S), np.float32)
    rgb, inside = rng.random((R, S, 3)).astype(np.float32), np.ones((R, S), np.uint8)
    weights, depth, opacity = np.empty((R, S), np.float32), np.empty(R), np.empty(R)
    exact, grey = np.empty((2, R, 3), np.float32)
    render_forward(sdf, rgb, inside, z, 10.0, weights, exact, depth, opacity)
    sample = np.zeros(R * S, np.int64)
    found = samples_with_color(weights, least, sample)
    assert sample[:found].tolist() == np.flatnonzero(weights.ravel() >= least).tolist()
    assert 0.1 * R * S < found < 0.9 * R * S
    kept = np.full((R * S, 3), 0.5, np.float32)
    kept[sample[:found]] = rgb.reshape(-1, 3)[sample[:found]]
    render_forward(sdf, kept.reshape(R, S, 3), inside, z, 10.0, weights, grey, depth, opacity)
    change = np.abs(exact - grey).max()
    assert 0 < change <= S * least / 2
