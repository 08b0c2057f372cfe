"""Tri-plane features: three axis-aligned feature images, summed."""

from collections.abc import Sequence

from torch import Tensor

from hsslam_node.field.layout import PLANE_AXES


def tri_plane_features(
    planes: Sequence[Tensor],
    points: Tensor,
    low: Tensor,
    cell_m: float,
    first: Tensor | float = 0.0,
) -> Tensor:
    """Sum of the bilinear features of the xy, xz and yz planes; border values outside.

    Args:
        planes: three of [n_v, n_u, C], axes as in PLANE_AXES.
        points: [N, 3] m, world.
        low: [3] m, where vertex (0, 0, 0) lies.
        cell_m: distance of two vertices, m.
        first: [3] number of the planes' first vertex along each axis.

    Returns:
        [N, C]

    Source: Johari et al., ESLAM (2023).
    """
    position = (points - low) / cell_m - first  # [N, 3] cells
    out = _bilinear(planes[0], position[:, PLANE_AXES[0][0]], position[:, PLANE_AXES[0][1]])
    for plane, (u, v) in zip(planes[1:], PLANE_AXES[1:], strict=True):
        out = out + _bilinear(plane, position[:, u], position[:, v])
    return out


def _bilinear(plane: Tensor, u: Tensor, v: Tensor) -> Tensor:
    """Features [N, C] of a plane [n_v, n_u, C] at vertex coordinates u, v [N]."""
    n_v, n_u, _ = plane.shape
    u0, fu = _cell_and_fraction(u, n_u)
    v0, fv = _cell_and_fraction(v, n_v)
    fu, fv = fu[:, None], fv[:, None]
    lower = (1.0 - fu) * plane[v0, u0] + fu * plane[v0, u0 + 1]
    upper = (1.0 - fu) * plane[v0 + 1, u0] + fu * plane[v0 + 1, u0 + 1]
    return (1.0 - fv) * lower + fv * upper


def _cell_and_fraction(position: Tensor, vertices: int) -> tuple[Tensor, Tensor]:
    """Index of the cell [N] and place in it [N] 0..1, clamped to the plane."""
    position = position.clamp(0.0, float(vertices - 1))
    cell = position.detach().floor().clamp(max=vertices - 2)
    return cell.long(), position - cell
