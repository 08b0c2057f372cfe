"""One-blob encoding of a position: a soft one-hot over 16 bins per axis."""

import torch
from torch import Tensor

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

    Beyond the box the value at its border.
    """
    t = ((points - low) / (high - low)).clamp(0.0, 1.0)  # [N, 3]
    return oneblob(t).flatten(-2)


def _quartic_cdf(u: Tensor) -> Tensor:
    """Integral of 15/16 (1 - u^2)^2 from -1 to u, for any u."""
    u = u.clamp(-1.0, 1.0)
    u2 = u * u
    return 0.5 + (15.0 / 16.0) * u * (1.0 - (2.0 / 3.0) * u2 + 0.2 * u2 * u2)
