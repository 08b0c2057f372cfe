"""Signed-distance losses within the truncation band."""

from torch import Tensor

from hsslam_node.losses.masked_mean import mean_of_ray_means

MIDDLE = 0.4  # half width of the middle of the band, in units of the truncation (ESLAM)


def sdf_losses(
    sdf: Tensor, z: Tensor, measured: Tensor, inside: Tensor, truncation_m: float
) -> tuple[Tensor, Tensor]:
    """Squared error of the signed distance in the middle and in the tail of the band, m^2.

    The target at a sample is D - z. Middle: |z - D| < 0.4 T; tail: the rest of |z - D| < T.
    Each is the mean over rays with depth of the ray's mean over its samples there, 0 where it has
    none. The paper's equation lacks the square.

    Args:
        sdf: [R, S] in units of the truncation.
        z: [R, S] m, planar depth of the samples.
        measured: [R] m, D, 0 = no measurement.
        inside: [R, S] bool, samples within the bound.
        truncation_m: T, m.

    Returns:
        middle loss, tail loss

    Source: paper III-B; Johari et al., ESLAM (2023).
    """
    offset = z - measured[:, None]  # [R, S] m
    squared = (sdf * truncation_m + offset).square()
    rays = measured > 0
    usable = inside & rays[:, None]
    middle = usable & (offset.abs() < MIDDLE * truncation_m)
    tail = usable & (offset.abs() < truncation_m) & ~middle
    return mean_of_ray_means(squared, middle, rays), mean_of_ray_means(squared, tail, rays)
