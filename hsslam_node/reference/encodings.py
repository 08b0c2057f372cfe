"""Reference of `kernels/field/one_blob.py` and `kernels/field/planes.py`.

One-blob encoding: a soft one-hot over 16 bins per axis. Tri-planes: three axis-aligned images, summed.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from hsslam_node.map.layout import PLANE_AXES

BINS = 16


def oneblob(t: Tensor) -> Tensor:
    """Encode one normalised coordinate as the mass of a quartic kernel in each of 16 bins.

    The kernel has radius 1/16 and is centred at `t`; bin i is [i/16, (i+1)/16]. Mass that falls
    outside [0, 1] is dropped, so the bins sum to one except within 1/16 of the borders.

    Args:
        t: [N], 0..1 over the side of the bound.

    Returns:
        [N, 16]

    Source: Müller et al., Neural Importance Sampling (2019); kernel as in tiny-cuda-nn.
    """
    borders = torch.arange(BINS + 1, dtype=t.dtype, device=t.device) / BINS  # [17]
    cdf = _quartic_cdf((borders - t[..., None]) * BINS)  # [N, 17]
    return cdf[..., 1:] - cdf[..., :-1]


def oneblob_of_points(points: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Encode points [N, 3] m as [N, 48], bins of x, y, z over the box low [3] to high [3] m.

    Points beyond the box get the value at its border.
    """
    t = ((points - low) / (high - low)).clamp(0.0, 1.0)  # [N, 3]
    return oneblob(t).flatten(-2)


def _quartic_cdf(u: Tensor) -> Tensor:
    """Integral of 15/16 (1 - u^2)^2 from -1 to u, for any u."""
    u = u.clamp(-1.0, 1.0)
    u2 = u * u
    return 0.5 + (15.0 / 16.0) * u * (1.0 - (2.0 / 3.0) * u2 + 0.2 * u2 * u2)


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
