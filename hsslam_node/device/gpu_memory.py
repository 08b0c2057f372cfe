"""Memory of a GPU: may a run begin on it, and what if it is full; apart, as processes without torch ask."""

import contextlib
import re
from collections.abc import Iterator

from hsslam_node.errors import OutOfMemoryError

LEAST_FREE_GB = 4.0
"""By calculation, not measured: 0.5 GB of CUDA's own for each of five processes, and at most 0.4 GB of work
space for each of mapper, bundle adjustment and tracker (preset `paper`)."""


def too_little_memory(free_bytes: int) -> str | None:
    """Why a run had better not begin on a GPU with so much free memory; None if it may."""
    if free_bytes >= LEAST_FREE_GB * 1e9:
        return None
    return f"the GPU has {free_bytes / 1e9:.1f} GB free: expected {LEAST_FREE_GB:g} GB"


@contextlib.contextmanager
def gpu_memory_errors() -> Iterator[None]:
    """What PyTorch, Triton and CUDA raise in the block when the memory of the GPU is full becomes one line.

    Raises:
        OutOfMemoryError: it is full.
    """
    try:
        yield
    except RuntimeError as error:  # torch.OutOfMemoryError is one; torch may not be imported here
        text = str(error)
        if "CUDA" not in text or not re.search("out of memory|ALLOC_FAILED", text):
            raise
        asked = re.search(r"Tried to allocate ([\d.]+ \w+)", text)
        more = f"{asked[1]} more" if asked else "more"
        raise OutOfMemoryError(
            f"GPU memory: full: expected {more} free: --device cpu needs none"
        ) from error
