import numpy as np
import pytest
from numba import njit

from hsslam_node.kernels.simd import (
    add,
    any_not_zero,
    div,
    fma,
    load,
    lowest_bit,
    mul,
    root,
    spread,
    store,
    sub,
    total,
    where_positive,
)
from hsslam_node.kernels.simd_pairs import (
    add_pairs,
    load_pairs,
    spread_pair,
    store_pair_total,
    transpose_pairs,
)

RNG = np.random.default_rng(0)


@njit
def _arithmetic(a, b, c, out):
    x, y, z = load(a, 3), load(b, 0), load(c, 1)
    store(out, 0, fma(x, y, z))
    store(out, 16, add(x, y))
    store(out, 32, sub(x, y))
    store(out, 48, mul(x, spread(a[0])))
    store(out, 64, where_positive(x, y))
    store(out, 80, div(x, y))
    store(out, 96, root(mul(x, x)))
    return total(x)


def test_arithmetic_at_any_offset():
    a, b, c = RNG.normal(size=(3, 20)).astype(np.float32)
    out = np.zeros(112, np.float32)
    x, y, z = a[3:19], b[:16], c[1:17]
    assert abs(_arithmetic(a, b, c, out) - x.sum()) < 1e-5
    expected = [x * y + z, x + y, x - y, x * a[0], np.where(x > 0, y, 0), x / y, abs(x)]
    np.testing.assert_allclose(out.reshape(7, 16), expected, rtol=1e-5, atol=1e-6)


@njit
def _pairs(values, offsets, grad, out):
    gathered = load_pairs(values, offsets, 1, 2)
    store(out, 0, gathered)
    store(out, 16, spread_pair(values, 5))
    store_pair_total(out, 32, gathered)
    add_pairs(grad, offsets, 1, 2, gathered)


def test_pairs_are_gathered_summed_and_scattered():
    values = RNG.normal(size=100).astype(np.float32)
    offsets = np.array([0, 3, 0, 90, 0, 3, 0, 41, 0, 40, 0, 7, 0, 3, 0, 60], np.int32)
    places = offsets[1::2]  # 3 occurs three times, 40 and 41 overlap
    grad, out = np.ones(100, np.float32), np.zeros(34, np.float32)
    _pairs(values, offsets, grad, out)
    pairs = np.stack([values[places], values[places + 1]], axis=1)  # [8, 2]
    np.testing.assert_array_equal(out[:16], pairs.ravel())
    np.testing.assert_array_equal(out[16:32], np.tile(values[5:7], 8))
    np.testing.assert_allclose(out[32:], pairs.sum(axis=0), rtol=1e-5)
    expected = np.ones(100)
    np.add.at(expected, places[:, None] + np.arange(2), pairs)
    np.testing.assert_allclose(grad, expected, rtol=1e-5, atol=1e-6)


@njit
def _transpose(target, source):
    transpose_pairs(target, 3, 20, source, 5, 24)


def test_pairs_are_transposed():
    source, target = RNG.normal(size=200).astype(np.float32), np.zeros(170, np.float32)
    _transpose(target, source)
    rows = np.lib.stride_tricks.sliding_window_view(source[5:], 16)[::24][:8].reshape(8, 8, 2)
    expected = np.zeros(170, np.float32)
    for i in range(8):
        expected[3 + 20 * i : 19 + 20 * i] = rows[:, i].ravel()
    np.testing.assert_array_equal(target, expected)


@njit
def _searched(values, offset, word):
    return any_not_zero(values, offset), lowest_bit(word)


@pytest.mark.parametrize("place", [0, 7, 15, None])
@pytest.mark.parametrize("value", [1.0, -1e-40, np.nan])
def test_what_is_not_zero_is_found(place: int | None, value: float):
    values = np.zeros(40, np.float32)
    values[[2, 19]] = 1.0  # beside the 16 floats that are asked for
    if place is not None:
        values[3 + place] = value
    assert _searched(values, 3, np.uint64(0))[0] == (place is not None)


@pytest.mark.parametrize("bit", [0, 1, 40, 63])
def test_the_lowest_bit_is_found(bit: int):
    word = np.uint64(1 << bit | 1 << 63)
    assert _searched(np.zeros(16, np.float32), 0, word)[1] == bit
