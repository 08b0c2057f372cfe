import torch

from hsslam_node.field.tri_plane import tri_plane_features

LOW = torch.tensor([-1.0, 0.0, 2.0], dtype=torch.float64)
CELL_M = 0.25


def _ramp(n_u, n_v, a, b, c):
    """A plane [n_v, n_u, 1] holding a u + b v + c."""
    v, u = torch.meshgrid(torch.arange(n_v), torch.arange(n_u), indexing="ij")
    return (a * u + b * v + c)[..., None].double()


def test_planes_are_summed_and_read_along_their_own_axes():
    planes = [_ramp(5, 6, 1, 10, 0), _ramp(5, 7, 100, 1000, 0), _ramp(6, 7, 1e4, 1e5, 0.5)]
    x, y, z = torch.rand(30), torch.rand(30) * 1.25, torch.rand(30) * 1.5
    points = LOW + torch.stack([x, y, z], -1).double()
    u = (points - LOW) / CELL_M
    expected = u[:, 0] * 101 + u[:, 1] * (10 + 1e4) + u[:, 2] * (1000 + 1e5) + 0.5
    actual = tri_plane_features(planes, points, LOW, CELL_M)[:, 0]
    torch.testing.assert_close(actual, expected)


def test_outside_takes_the_border_value():
    planes = [torch.rand(4, 4, 8, dtype=torch.float64) for _ in range(3)]
    outside = LOW + torch.tensor([[-3.0, 9.0, 0.3]], dtype=torch.float64)
    border = LOW + torch.tensor([[0.0, 0.75, 0.3]], dtype=torch.float64)
    torch.testing.assert_close(
        tri_plane_features(planes, outside, LOW, CELL_M),
        tri_plane_features(planes, border, LOW, CELL_M),
    )


def test_gradients_match_finite_differences():
    planes = [torch.rand(4, 4, 2, dtype=torch.float64, requires_grad=True) for _ in range(3)]
    points = (LOW + torch.rand(4, 3, dtype=torch.float64) * 0.7).requires_grad_()

    def features(points, *planes):
        return tri_plane_features(planes, points, LOW, CELL_M)

    assert torch.autograd.gradcheck(features, (points, *planes))
