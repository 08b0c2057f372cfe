"""Free-space loss."""

from torch import Tensor

from hsslam_node.losses.masked_mean import mean_of_ray_means


def free_space_loss(
    sdf: Tensor, z: Tensor, measured: Tensor, inside: Tensor, truncation_m: float
) -> Tensor:
    """Squared difference of the signed distance from 1 in front of the surface (z < D - T).

    The paper's condition |z - D| >= T would make the space behind surfaces free; that space is not
    supervised here. Mean over rays with depth of the ray's mean over its samples there.

    Args:
        sdf: [R, S] in units of the truncation.
        z: [R, S] m, planar depth of the samples.
        measured: [R] m, D, 0 = no measurement.
        inside: [R, S] bool, samples within the bound.
        truncation_m: T, m.

    Source: paper III-B.
    """
    rays = measured > 0
    free = inside & rays[:, None] & (z < measured[:, None] - truncation_m)
    return mean_of_ray_means((sdf - 1.0).square(), free, rays)
