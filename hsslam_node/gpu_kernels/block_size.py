"""How much of a batch one program of a kernel takes; a file of its own as all launchers share it."""

from torch import Tensor

_INTERPRETED = 128


def block_size(on_gpu: int, where: Tensor) -> int:
    """Rows of one program: `on_gpu`, or more in Triton's interpreter, where a program costs the same.

    `where`: any tensor that the kernel is launched on.
    """
    return on_gpu if where.is_cuda else max(on_gpu, _INTERPRETED)
