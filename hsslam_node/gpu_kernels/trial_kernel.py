"""A small kernel that tests Triton, driver and compiler; alone, as it imports nothing else."""

import torch
import triton
import triton.language as tl

_SIZE = 16


def trial_error(torch_device: str) -> float:
    """Largest error of a small matrix product with atomic sums; far below 1e-4 if everything works.

    Raises any error of PyTorch, Triton or the compiler.
    """
    a = torch.linspace(-1.0, 1.0, _SIZE * _SIZE, dtype=torch.float32).reshape(_SIZE, _SIZE)
    found = torch.zeros(_SIZE, _SIZE, device=torch_device)
    _add_square[(2,)](a.to(torch_device), found, _SIZE)
    expected = 2.0 * (a.double() @ a.double())
    return float((found.cpu().double() - expected).abs().max())


@triton.jit
def _add_square(a, out, SIZE: tl.constexpr):
    place = tl.arange(0, SIZE)[:, None] * SIZE + tl.arange(0, SIZE)[None, :]
    block = tl.load(a + place)
    tl.atomic_add(out + place, tl.dot(block, block, input_precision="ieee"))
