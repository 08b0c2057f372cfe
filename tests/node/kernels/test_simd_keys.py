import numpy as np
import pytest
from numba import njit

from hsslam_node.kernels.simd import load, spread, store
from hsslam_node.kernels.simd_keys import (
    add_keys,
    any_less,
    equal_bits,
    largest_key,
    least_keys,
    masked_keys,
    where_bits,
    where_less,
)

RNG = np.random.default_rng(0)


@njit
def _arithmetic(a, b, mask, out):
    x, y = load(a, 3), load(b, 1)
    store(out, 0, add_keys(x, y))
    store(out, 16, least_keys(x, y))
    store(out, 32, where_less(x, y, spread(a.dtype.type(7)), x))
    store(out, 48, where_bits(equal_bits(mask, 2, np.uint8(1)), x, y))
    store(out, 64, masked_keys(x, y))
    return largest_key(x)


@njit
def _is_any_less(a, b):
    return any_less(load(a, 0), load(b, 0))


@pytest.mark.parametrize("kind", [np.uint32, np.uint64])
@pytest.mark.parametrize("lane", [0, 15])
def test_one_lane_that_is_less_is_found(kind, lane):
    a = np.full(16, np.iinfo(kind).max - 1, kind)
    b = a.copy()
    assert not _is_any_less(a, b)
    b[lane] += kind(1)
    assert _is_any_less(a, b) and not _is_any_less(b, a)


@pytest.mark.parametrize("kind", [np.uint32, np.uint64])
def test_arithmetic_at_any_offset(kind):
    """The largest keys too, which are negative as signed numbers."""
    most = np.iinfo(kind).max
    a, b = RNG.integers(0, most, (2, 20), kind, endpoint=True)
    mask = RNG.integers(0, 3, 20).astype(np.uint8)
    out = np.zeros(80, kind)
    largest = _arithmetic(a, b, mask, out)
    x, y = a[3:19], b[1:17]
    assert largest == x.max() and x.max() > most // 2
    chosen = [np.where(x < y, kind(7), x), np.where(mask[2:18] == 1, x, y)]
    expected = [x + y, np.minimum(x, y), *chosen, x & y]
    np.testing.assert_array_equal(out.reshape(5, 16), expected)
