"""Rows of a batch that one program of a kernel processes; a file of its own as all launchers share it."""

from torch import Tensor

_INTERPRETED = 128


def block_size(on_gpu: int, where: Tensor) -> int:
    """Rows of one program: `on_gpu`; in Triton's interpreter more, as each program costs the same there.

    `where`: any tensor that the kernel is launched on.
    """
    return on_gpu if where.is_cuda else max(on_gpu, _INTERPRETED)
