import numpy as np
import torch

from hsslam_node.kernels.field.sdf_query import query_sdf


def _query(field, points, params=None):
    n = len(points)
    sdf, inside = np.empty(n, np.float32), np.empty(n, np.uint8)
    gradient = np.empty((n, 3), np.float32)
    params = field.params if params is None else params
    query_sdf(params, field.kernel, points, sdf, inside, gradient, True)
    return sdf, inside.astype(bool), gradient


def test_distance_and_gradient_are_the_reference(field, close):
    points = field.points(600, seed=2)
    sdf, inside, gradient = _query(field, points)
    x = torch.from_numpy(points.astype(np.float64)).requires_grad_()
    expected = field.reference.sdf(x)
    (slope,) = torch.autograd.grad(expected.sum(), x)
    assert inside.all()
    close(sdf, expected.detach())
    close(gradient, slope, 2e-3)


def test_outside_is_free_and_flat(field, close):
    points = field.points(300, seed=3, reach=1.6)
    sdf, inside, gradient = _query(field, points)
    np.testing.assert_array_equal(inside, field.layout.bound.contains(points))
    assert (sdf[~inside] == 1.0).all() and not gradient[~inside].any()
    with torch.no_grad():
        expected = field.reference.sdf(torch.from_numpy(points[inside].astype(np.float64)))
    close(sdf[inside], expected)


def test_the_geometry_prefix_is_enough(field):
    points = field.points(50)
    prefix = field.params[: field.layout.geometry_count].copy()
    np.testing.assert_array_equal(_query(field, points, prefix)[0], _query(field, points)[0])
