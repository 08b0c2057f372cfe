"""What a user is told when the memory of a GPU does not suffice; no GPU is needed for that."""

import pytest
import torch

from hsslam_node.device.gpu_memory import LEAST_FREE_GB, gpu_memory_errors, too_little_memory
from hsslam_node.errors import OutOfMemoryError


@pytest.mark.parametrize(
    ("error", "asked"),
    [
        (torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.50 GiB. GPU 0"), "2.50 GiB more"),
        (RuntimeError("Triton Error [CUDA]: out of memory"), "more"),
        (RuntimeError("CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `create`"), "more"),
    ],
)  # fmt: skip
def test_a_full_gpu_is_one_line(error: RuntimeError, asked: str):
    told = f"^GPU memory is full: expected {asked} free, or --device cpu$"
    with pytest.raises(OutOfMemoryError, match=told), gpu_memory_errors():
        raise error


def test_other_errors_stay_what_they_are():
    with pytest.raises(RuntimeError, match=r"^CUDA error: illegal"), gpu_memory_errors():
        raise RuntimeError("CUDA error: illegal memory access")


def test_a_gpu_that_others_have_filled_is_not_begun_on():
    assert too_little_memory(int(LEAST_FREE_GB * 1e9)) is None
    assert too_little_memory(900_000_000) == "the GPU has 0.9 GB free: expected 4 GB"
