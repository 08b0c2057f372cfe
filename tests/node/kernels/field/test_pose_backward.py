import numpy as np

from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.backward import field_backward
from hsslam_node.kernels.field.forward import field_forward
from hsslam_node.kernels.field.gradient import gradient
from hsslam_node.kernels.field.pose_backward import field_pose_backward


def test_points_get_the_gradient_of_the_whole_backward_pass(field):
    n = 600
    points = field.points(n, seed=5, reach=1.6)
    rng = np.random.default_rng(3)
    d_sdf = rng.normal(size=n).astype(np.float32)
    d_rgb = rng.normal(size=(n, 3)).astype(np.float32)
    acts, grad = field_activations(field.kernel, n), gradient(field.kernel)
    expected = np.full((n, 3), np.nan, np.float32)
    field_forward(field.params, field.kernel, points, n, acts)
    field_backward(field.params, field.kernel, n, acts, d_sdf, d_rgb, grad, expected, True)
    d_points = np.full((n, 3), np.nan, np.float32)
    params = field.params.copy()
    field_pose_backward(params, field.kernel, n, acts, d_sdf, d_rgb, d_points)
    np.testing.assert_allclose(d_points, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
    np.testing.assert_array_equal(params, field.params)
    outside = acts.inside == 0
    assert outside.any() and not d_points[outside].any() and d_points[~outside].all()
