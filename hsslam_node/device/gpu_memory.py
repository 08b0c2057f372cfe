"""GPU memory: whether a run may begin, and errors if it is full; apart, for processes without torch."""

import contextlib
import re
from collections.abc import Iterator

from hsslam_node.errors import GPU_IS_FULL, OutOfMemoryError

LEAST_FREE_GB = 4.0
"""Of 0.5 GB for CUDA itself in each of five processes, and at most 0.4 GB of work space for each of mapper,
bundle adjustment and tracker (preset `paper`). A run with preset `realtime` had 3.3 GB in use on an H200."""


def too_little_memory(free_bytes: int) -> str | None:
    """Why `free_bytes` of a GPU are too few to begin a run; None if they suffice."""
    if free_bytes >= LEAST_FREE_GB * 1e9:
        return None
    return f"the GPU has {free_bytes / 1e9:.1f} GB free: expected {LEAST_FREE_GB:g} GB"


@contextlib.contextmanager
def gpu_memory_errors() -> Iterator[None]:
    """Turn errors of PyTorch, Triton and CUDA in the block into one line if the GPU's memory is full.

    Raises:
        OutOfMemoryError: the GPU's memory is full.
    """
    try:
        yield
    except RuntimeError as error:  # base of torch.OutOfMemoryError; torch may be missing
        text = str(error)
        if "CUDA" not in text or not re.search("out of memory|ALLOC_FAILED", text):
            raise
        asked = re.search(r"Tried to allocate ([\d.]+ \w+)", text)
        more = f"{asked[1]} more" if asked else "more"
        raise OutOfMemoryError(f"{GPU_IS_FULL}: expected {more} free, or --device cpu") from error
