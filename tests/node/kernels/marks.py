"""The marks of a gradient, chunk by chunk."""

from collections.abc import Iterable

import numpy as np

from hsslam_node.kernels.field.gradient import Gradient, touch_range


def touch(grad: Gradient, chunks: Iterable[int]) -> None:
    """Mark these chunks of 16 floats."""
    for chunk in chunks:
        touch_range(grad, 16 * int(chunk), 16 * int(chunk) + 16)


def touched_chunks(grad: Gradient) -> np.ndarray:
    """The chunks that are marked, ascending."""
    return np.flatnonzero(np.unpackbits(grad.touched.view(np.uint8), bitorder="little"))
