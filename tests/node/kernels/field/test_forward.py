import numpy as np
import torch

from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.forward import field_forward


def test_distance_and_colour_are_the_reference(field, close):
    points = field.points(700)  # more than two blocks, the last not full
    acts = field_activations(field.kernel, 700)
    field_forward(field.params, field.kernel, points, 700, acts)
    with torch.no_grad():
        expected = field.reference(torch.from_numpy(points.astype(np.float64)))
    close(acts.sdf, expected.sdf)
    close(acts.rgb, expected.color)
    close(acts.geometry_in[:, :32], expected.hash_feature)
    assert acts.inside.all()


def test_points_outside_are_masked_and_disturb_nobody(field, close):
    points = field.points(300, seed=1, reach=1.6)
    acts = field_activations(field.kernel, 300)
    field_forward(field.params, field.kernel, points, 300, acts)
    with torch.no_grad():
        expected = field.reference(torch.from_numpy(points.astype(np.float64)))
    inside = expected.inside.numpy()
    assert 20 < inside.sum() < 280
    np.testing.assert_array_equal(acts.inside.astype(bool), inside)
    close(acts.sdf[inside], expected.sdf[inside])
    close(acts.rgb[inside], expected.color[inside])
    assert (acts.sdf[~inside] == 1.0).all() and np.isfinite(acts.rgb).all()


def test_points_far_away_and_on_the_border_are_safe(field):
    low, high = np.array(field.layout.bound.low), np.array(field.layout.bound.high)
    points = np.stack([low, high, high * 1e6, low * 1e6 - 1, (low + high) / 2]).astype(np.float32)
    acts = field_activations(field.kernel, 5)
    field_forward(field.params, field.kernel, points, 5, acts)
    assert np.isfinite(acts.sdf).all() and np.isfinite(acts.rgb).all()
    assert acts.inside[2:].tolist() == [0, 0, 1]


def test_only_the_first_n_points_are_written(field):
    acts = field_activations(field.kernel, 20)
    acts.sdf[:] = 7.0
    field_forward(field.params, field.kernel, field.points(20), 10, acts)
    assert (acts.sdf[10:] == 7.0).all() and (acts.sdf[:10] != 7.0).all()
