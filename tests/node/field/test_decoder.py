import torch

from hsslam_node.field.decoder import decode_color, decode_geometry


def test_geometry_is_a_bounded_distance_and_a_feature():
    W1, W2 = torch.randn(20, 32), torch.randn(32, 16)
    x = torch.randn(9, 20) * 10
    sdf, g = decode_geometry(x, W1, W2)
    out = torch.clamp(x @ W1, min=0) @ W2
    assert sdf.shape == (9,) and g.shape == (9, 15)
    torch.testing.assert_close(sdf, torch.tanh(out[:, 0]))
    torch.testing.assert_close(g, out[:, 1:])
    assert float(sdf.abs().max()) <= 1.0


def test_color_is_between_zero_and_one():
    color = decode_color(torch.randn(50, 20) * 10, torch.randn(20, 32), torch.randn(32, 3))
    assert color.shape == (50, 3)
    assert float(color.min()) >= 0.0 and float(color.max()) <= 1.0


def test_zero_features_give_the_middle():
    sdf, _ = decode_geometry(torch.zeros(1, 20), torch.randn(20, 32), torch.randn(32, 16))
    color = decode_color(torch.zeros(1, 20), torch.randn(20, 32), torch.randn(32, 3))
    assert float(sdf) == 0.0
    torch.testing.assert_close(color, torch.full((1, 3), 0.5))
