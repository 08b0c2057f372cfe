"""A gradient over all parameters that marks where it was written: one bit for every 16 floats.

Twin: `Gradient` in `gpu_kernels/field/activations.py`.
"""

from typing import NamedTuple

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.kernels.field.layout import KernelLayout
from hsslam_node.kernels.simd import (
    add,
    aligned_zeros,
    any_not_zero,
    load,
    lowest_bit,
    spread,
    store,
)
from hsslam_node.map.parameter_arrays import PAGE

STRIPE = 64  # pages that a worker takes in turn, as touched pages lie together


class Gradient(NamedTuple):
    """Gradient whose cost to step does not depend on the size of the map, as steps read only marked chunks.

    Hash tables have no marks, as they do not grow with the map and an iteration writes four tenths of their
    chunks. A step reads them whole and treats each chunk that is not zero as touched.
    """

    values: np.ndarray  # [P] float32, zero outside the touched chunks
    touched: np.ndarray  # [ceil(P / 16 / PAGE)] uint64, bit k of a page's word is its chunk k
    unmarked: np.ndarray  # [2] int64, first chunk of the hash tables and the one after their last


def gradient(
    layout: KernelLayout, values: np.ndarray | None = None, touched: np.ndarray | None = None
) -> Gradient:
    """An empty gradient for all parameters, over arrays of zeros [P] and [ceil(P / 16 / PAGE)] if given."""
    P = layout.parameter_count
    tables = (layout.hash_offset[0], layout.geometry_W1) if len(layout.hash_offset) else (0, 0)
    if values is None or touched is None:
        values, touched = aligned_zeros(P), np.zeros(-(-P // (16 * PAGE)), np.uint64)
    return Gradient(values, touched, np.array(tables, np.int64) // 16)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def touch_rows(grad, first, row, C):
    """Mark the four corners of a plane's cell: 2 C floats from `first` and from `first + row` on."""
    bits = np.uint64((1 << (C >> 3)) - 1)
    for start in (first, first + row):
        page, shift = start >> 10, np.uint64(start >> 4 & 63)
        grad.touched[page] |= bits << shift
        beyond = bits >> (np.uint64(63) - shift) >> np.uint64(1)  # not by 64 at once
        if beyond != 0:
            grad.touched[page + 1] |= beyond


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def touch_range(grad, first, last):
    """Mark all chunks of floats first to last - 1."""
    for chunk in range(first >> 4, ((last - 1) >> 4) + 1):
        grad.touched[chunk >> 6] |= np.uint64(1) << np.uint64(chunk & 63)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def add_gradient(grad, other, worker, workers):
    """Add `other` to `grad` and clear `other`, in the stripes of one worker; stripes do not overlap."""
    zero = spread(np.float32(0.0))
    chunks = grad.values.shape[0] >> 4
    for page in range(grad.touched.shape[0]):
        if page // STRIPE % workers != worker:
            continue
        left = other.touched[page]
        other.touched[page] = 0
        start, stop = page * PAGE, min((page + 1) * PAGE, chunks)
        for chunk in range(max(start, other.unmarked[0]), min(stop, other.unmarked[1])):
            left |= np.uint64(any_not_zero(other.values, chunk << 4)) << np.uint64(chunk & 63)
        grad.touched[page] |= left
        while left != 0:
            o = (page * PAGE + lowest_bit(left)) << 4
            left &= left - np.uint64(1)
            store(grad.values, o, add(load(grad.values, o), load(other.values, o)))
            store(other.values, o, zero)
