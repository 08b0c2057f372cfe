"""Smoothness of the hash feature in a small random cube."""

import numpy as np
from torch import Tensor

from hsslam_node.geometry.bound import Bound


def smoothness_loss(feature: Tensor) -> Tensor:
    """Squared differences of the feature between neighbouring vertices, per vertex.

    Args:
        feature: [n, n, n, F] hash feature at the vertices of a cube.

    Source: paper III-B; Wang et al., Co-SLAM (2023).
    """
    squares = [feature.diff(dim=axis).square().sum() for axis in range(3)]
    return (squares[0] + squares[1] + squares[2]) / feature[..., 0].numel()


def smoothness_cube(
    bound: Bound, vertices: int, cell_m: float, generator: np.random.Generator
) -> np.ndarray:
    """Vertices [n, n, n, 3] float32 m of a random cube, clamped to the bound."""
    side_m = (vertices - 1) * cell_m
    slack = np.maximum(bound.extent_m - side_m, 0.0)
    origin = np.asarray(bound.low) + generator.random(3) * slack
    steps = np.arange(vertices) * cell_m
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    return np.clip(origin + grid, bound.low, bound.high).astype(np.float32)
