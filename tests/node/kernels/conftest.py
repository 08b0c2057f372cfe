"""A small field with random parameters: flat float32, kernel layout, float64 reference."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from hsslam_node.config import FieldConfig
from hsslam_node.geometry.bound import Bound
from hsslam_node.kernels.field.layout import KernelLayout, kernel_layout
from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.map.layout import FieldLayout
from hsslam_node.reference.field import HybridField


@dataclass(frozen=True)
class Field:
    layout: FieldLayout
    kernel: KernelLayout
    params: np.ndarray  # [P] float32
    reference: HybridField  # float64

    def points(self, count: int, seed: int = 0, reach: float = 1.0) -> np.ndarray:
        """Random points [count, 3] float32, none within 1e-3 cells of a grid line of any level."""
        rng = np.random.default_rng(seed)
        low, extent = np.array(self.layout.bound.low), self.layout.bound.extent_m
        origin, longest = np.array(self.layout.lattice.low), self.layout.lattice.extent_m.max()
        config = self.layout.config
        cells = [r / longest for r in self.layout.hash_resolutions]
        for cell_m in (config.coarse_cell_m, config.appearance_fine_cell_m):
            cells.append(1.0 / cell_m)
        cells.append(1.0 / config.geometry_fine_cell_m)
        kept = np.zeros((0, 3), np.float32)
        while len(kept) < count:
            unit = (rng.random((4 * count, 3)) - 0.5) * reach + 0.5
            points = (low + unit * extent).astype(np.float32)
            grid = (points.astype(np.float64) - origin)[..., None] * np.array(cells)
            clear = (np.abs(grid - np.rint(grid)) > 1e-3).all(axis=(1, 2))
            kept = np.concatenate([kept, points[clear]])
        return kept[:count]


def field_of(config: FieldConfig, *, grown: bool = False) -> Field:
    """A field of this configuration over a small room, every block filled with noise."""
    layout = FieldLayout.over(config, Bound((-1.0, -0.5, 0.2), (0.9, 0.7, 1.3)))
    if grown:
        layout = layout.grown(Bound((-1.7, -0.4, -0.6), (1.9, 0.9, 1.2)))
    params = initial_parameters(layout, 0)
    noise = np.random.default_rng(0).normal(0, 0.1, layout.parameter_count).astype(np.float32)
    for block in layout.blocks.values():
        if block.name != "log_beta":
            block.view(params)[...] += block.view(noise)
    reference = HybridField(layout, torch.from_numpy(params.astype(np.float64)))
    return Field(layout, kernel_layout(layout), params, reference)


@pytest.fixture(
    scope="session",
    params=[(16, False), (32, False), (16, True)],
    ids=["16 channels", "32 channels", "grown"],
)
def field(request) -> Field:
    channels, grown = request.param
    field = field_of(FieldConfig(plane_channels=channels, hash_table_log2=13), grown=grown)
    assert field.layout.hash_is_dense[0] and not field.layout.hash_is_dense[-1]
    return field


@pytest.fixture(scope="session")
def close():
    """Assert that two arrays agree in relative L2 norm."""

    def check(actual, expected, tolerance=1e-4):
        actual, expected = np.asarray(actual, np.float64), np.asarray(expected, np.float64)
        assert actual.shape == expected.shape
        scale = np.linalg.norm(expected)
        assert scale > 0
        assert np.linalg.norm(actual - expected) / scale < tolerance

    return check
