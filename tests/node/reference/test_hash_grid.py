import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.reference.hash_grid import dense_index, hash_grid_features, hashed_index


def _tables(layout, value=None):
    generator = torch.Generator().manual_seed(0)
    tables = []
    for entries in layout.hash_entries:
        table = torch.randn(entries, 2, generator=generator, dtype=torch.float64)
        tables.append(table if value is None else torch.full_like(table, value))
    return tables


def _points(layout, count):
    generator = torch.Generator().manual_seed(1)
    low = torch.tensor(layout.bound.low, dtype=torch.float64)
    extent = torch.from_numpy(layout.bound.extent_m)
    return low + torch.rand(count, 3, generator=generator, dtype=torch.float64) * extent


def test_fixture_has_dense_and_hashed_levels(layout):
    assert layout.hash_is_dense[0] and not layout.hash_is_dense[-1]


@given(*[st.integers(-4000, 4000)] * 3, st.integers(8, 20))
def test_hash_is_the_xor_of_uint32_products(x, y, z, log2):
    x32, y32, z32 = np.array([x, y, z]).astype(np.uint32)
    with np.errstate(over="ignore"):
        h = x32 ^ (y32 * np.uint32(2654435761)) ^ (z32 * np.uint32(805459861))
    expected = int(h) & ((1 << log2) - 1)
    vertex = torch.tensor([[x, y, z]])
    assert int(hashed_index(vertex, 1 << log2)) == expected


def test_dense_index_visits_every_entry_once():
    sides = torch.arange(-1, 5), torch.arange(0, 7), torch.arange(-3, 2)
    vertices = torch.stack(torch.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 3)
    index = dense_index(vertices, (-1, 0, -3), (6, 7, 5))
    assert sorted(index.tolist()) == list(range(210))
    assert int(dense_index(torch.tensor([[1, 2, -1]]), (-1, 0, -3), (6, 7, 5))) == 2 + 12 + 84


def test_constant_tables_give_the_constant(layout):
    features = hash_grid_features(layout, _tables(layout, 0.7), _points(layout, 100))
    np.testing.assert_allclose(features.numpy(), 0.7, atol=1e-12)


def test_a_vertex_gives_its_own_entry(layout):
    tables = _tables(layout)
    for level in (0, len(tables) - 1):
        resolution = layout.hash_resolutions[level]
        first, count = layout.hash_vertices(level)
        vertex = torch.tensor([[3, 1, 2]])
        cell_m = float(layout.bound.extent_m.max()) / resolution
        point = torch.tensor(layout.bound.low, dtype=torch.float64) + vertex.double() * (cell_m)
        feature = hash_grid_features(layout, tables, point)[0, 2 * level : 2 * level + 2]
        dense = layout.hash_is_dense[level]
        entries = len(tables[level])
        index = dense_index(vertex, first, count) if dense else hashed_index(vertex, entries)
        torch.testing.assert_close(feature, tables[level][index][0], atol=1e-9, rtol=0)


def test_features_are_continuous_and_clamped_outside(layout):
    tables = _tables(layout)
    points = _points(layout, 50)
    step = torch.full((1, 3), 1e-9, dtype=torch.float64)
    a, b = (
        hash_grid_features(layout, tables, points),
        hash_grid_features(layout, tables, points + step),
    )
    torch.testing.assert_close(a, b, atol=1e-5, rtol=0)
    outside = torch.tensor([[-50.0, -50.0, -50.0]], dtype=torch.float64)
    corner = torch.tensor([layout.bound.low], dtype=torch.float64)
    torch.testing.assert_close(
        hash_grid_features(layout, tables, outside), hash_grid_features(layout, tables, corner)
    )


def test_gradients_match_finite_differences(layout):
    tables = _tables(layout)
    points = _points(layout, 3).requires_grad_()
    assert torch.autograd.gradcheck(lambda p: hash_grid_features(layout, tables, p), (points,))


@pytest.mark.parametrize("level", [0, 15])
def test_gradient_to_a_table_sums_to_the_weights(layout, level):
    tables = [table.requires_grad_() for table in _tables(layout)]
    hash_grid_features(layout, tables, _points(layout, 20)).sum().backward()
    assert float(tables[level].grad.sum()) == pytest.approx(20 * 2)  # weights of a point sum to 1
