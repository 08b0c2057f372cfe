"""Rectangles side by side on one image, in rows of falling height; alone, as it knows no mesh."""

import math

import numpy as np


def pack(sizes: np.ndarray) -> tuple[np.ndarray, tuple[int, int]]:
    """Place rectangles of sizes [n, 2] (width, height) px: corners [n, 2] int64, and the image's size.

    None overlap. The image is about as wide as high. The same sizes give the same places.
    """
    sizes = np.asarray(sizes, np.int64)
    place = np.zeros_like(sizes)
    if len(sizes) == 0:
        return place, (1, 1)
    width = max(math.ceil(math.sqrt(sizes.prod(axis=1).sum())), int(sizes[:, 0].max()))
    x = y = row_height = 0
    for k in np.lexsort((-sizes[:, 0], -sizes[:, 1])):
        wide, high = sizes[k]
        if x + wide > width:
            x, y, row_height = 0, y + row_height, 0
        place[k] = x, y
        x, row_height = x + wide, max(row_height, high)
    return place, (width, int(y + row_height))
