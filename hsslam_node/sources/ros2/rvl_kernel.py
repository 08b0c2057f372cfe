"""Decodes the numbers of an RVL image; alone because it imports numba, which few ROS cameras need.

A number has groups of 3 bits, the lowest first, each in a nibble whose highest bit says that another follows;
words of 32 bits have their first nibble at the top. The numbers of an image are: a count of zeros, a count of
other pixels, and the step to each of these from the one before; again and again.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit

_MOST_BITS = 33  # of a number; more is damage


@njit(cache=True, nogil=True, error_model="numpy")
def _number(words, place):
    value, shift = 0, 0
    while place < 8 * len(words) and shift < _MOST_BITS:
        nibble = (np.int64(words[place >> 3]) >> (28 - 4 * (place & 7))) & 15
        value |= (nibble & 7) << shift
        place += 1
        shift += 3
        if nibble < 8:
            return value, place
    return -1, place


@njit(cache=True, nogil=True, error_model="numpy")
def decode_rvl(words, depth):
    """Decode words [M] uint32 into depth [N] uint16, which must be 0; returns whether they were whole."""
    at, place, previous = 0, 0, 0
    while at < len(depth):
        zeros, place = _number(words, place)
        others, place = _number(words, place)
        if zeros < 0 or others < 0 or at + zeros + others > len(depth):
            return False
        at += zeros
        for _ in range(others):
            step, place = _number(words, place)
            if step < 0:
                return False
            previous += (step >> 1) ^ -(step & 1)
            depth[at] = previous & 0xFFFF
            at += 1
    return True
