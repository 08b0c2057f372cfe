import numpy as np
import pytest
from numba import njit

from hsslam_node.kernels.simd import load
from hsslam_node.kernels.simd_rows import store_columns

RNG = np.random.default_rng(0)


@njit
def _columns(table, rows, offset, out):
    store_columns(out, offset, out.shape[1], table, load(rows, 0))


@pytest.mark.parametrize("kind", [np.uint32, np.uint64])
def test_columns_of_rows_in_any_order(kind):
    table = RNG.random((40, 8)).astype(np.float32)
    rows = RNG.integers(0, 40, 16).astype(kind)
    out = np.full((8, 25), -1, np.float32)
    _columns(table, rows, 4, out)
    np.testing.assert_array_equal(out[:, 4:20], table[rows].T)
    assert (out[:, :4] == -1).all() and (out[:, 20:] == -1).all()
