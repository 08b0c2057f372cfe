"""A bound that grows changes nothing of what the field says within the old one."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.config import FieldConfig
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.growth import copy_grown
from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.map.layout import FieldLayout
from hsslam_node.reference.field import HybridField

FIRST = Bound((-1.0, -0.5, 0.2), (0.9, 0.7, 1.3))
_KINDS = {
    "all": FieldConfig(plane_channels=16, hash_table_log2=13),
    "planes": FieldConfig(plane_channels=16, hash_levels=0, oneblob_bins=0),
    "hash and one-blob": FieldConfig(plane_channels=0, hash_table_log2=13),
}


def _grown(old: FieldLayout, params: np.ndarray, bound: Bound) -> tuple[FieldLayout, np.ndarray]:
    new = old.grown(bound)
    grown = initial_parameters(new, 7)
    copy_grown(old, params, new, grown)
    return new, grown


def _noise(layout: FieldLayout, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(0, 0.2, layout.parameter_count).astype(np.float32)


@pytest.mark.parametrize("config", _KINDS.values(), ids=_KINDS.keys())
def test_the_field_says_the_same_within_the_old_bound(config):
    """Grown twice, to all sides; the borders of the old bound included."""
    layout = FieldLayout.over(config, FIRST)
    params = _noise(layout)
    low, high = np.array(layout.bound.low), np.array(layout.bound.high)
    points = low + np.random.default_rng(1).random((500, 3)) * (high - low)
    points[0], points[1] = low, high
    before = HybridField(layout, torch.from_numpy(params.astype(np.float64)))(
        torch.from_numpy(points)
    )
    larger = [Bound((-3.0, -0.6, 0.0), (0.9, 0.7, 1.4)), Bound((-2.0, -0.2, -1.1), (4.0, 2.0, 1.3))]
    for bound in larger:
        layout, params = _grown(layout, params, bound)
        field = HybridField(layout, torch.from_numpy(params.astype(np.float64)))
        after = field(torch.from_numpy(points))
        torch.testing.assert_close(after.sdf, before.sdf, atol=1e-9, rtol=0)
        torch.testing.assert_close(after.color, before.color, atol=1e-9, rtol=0)
        assert bool(after.inside[2:].all())


sides = st.lists(st.floats(0.0, 3.0), min_size=6, max_size=6)


@given(reach=sides)
def test_the_new_bound_covers_both_in_cells_of_the_old_lattice(reach):
    layout = FieldLayout.over(_KINDS["all"], FIRST)
    wanted = Bound.of(np.subtract(FIRST.low, reach[:3]), np.add(FIRST.high, reach[3:]))
    grown = layout.grown(wanted).bound
    assert (np.array(grown.low) <= np.minimum(layout.bound.low, wanted.low) + 1e-6).all()
    assert (np.array(grown.high) >= np.maximum(layout.bound.high, wanted.high) - 1e-6).all()
    cells = np.subtract(layout.bound.low, grown.low) / layout.config.coarse_cell_m
    np.testing.assert_allclose(cells, np.rint(cells), atol=1e-6)
    assert layout.grown(wanted).grown(FIRST) == layout.grown(wanted)


def test_every_old_vertex_is_moved_once():
    """Numbered parameters all arrive, and nothing else is overwritten."""
    old = FieldLayout.over(_KINDS["all"], FIRST)
    new = old.grown(Bound((-2.0, -0.5, -1.0), (2.0, 1.4, 1.3)))
    source = np.arange(1, old.parameter_count + 1, dtype=np.float32)
    target = np.zeros(new.parameter_count, np.float32)
    copy_grown(old, source, new, target)
    expected = np.concatenate([block.view(source).ravel() for block in old.blocks.values()])
    np.testing.assert_array_equal(np.sort(target[target > 0]), np.sort(expected))


def test_decoders_and_hashed_levels_keep_their_place_in_the_blocks():
    old = FieldLayout.over(_KINDS["all"], FIRST)
    source = _noise(old)
    new, target = _grown(old, source, Bound((-2.0, -0.5, -1.0), (2.0, 1.4, 1.3)))
    hashed = [f"hash.{k:02d}" for k, dense in enumerate(old.hash_is_dense) if not dense]
    assert hashed
    for name in ("geometry_decoder.W1", "color_decoder.W2", "log_beta", *hashed):
        np.testing.assert_array_equal(new.blocks[name].view(target), old.blocks[name].view(source))
