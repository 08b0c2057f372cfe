"""Smoothness of the hash feature in a cube on the GPU, with its gradient.

Twin: `kernels/mapping/smoothness.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size
from hsslam_node.gpu_kernels.field.activations import Gradient
from hsslam_node.gpu_kernels.field.decoder import relative_position
from hsslam_node.gpu_kernels.field.hash_grid import gather_hash, scatter_hash
from hsslam_node.gpu_kernels.field.layout import GpuLayout

BLOCK = 32  # vertices of one program


def smoothness_backward(
    params: Tensor,
    layout: GpuLayout,
    cube: Tensor,
    scale: float,
    grad: Gradient,
    feature: Tensor,
    loss: Tensor,
) -> None:
    """Write the loss of the cube's vertices [n, n, n, 3] (m, world, in the bound) to `loss` [1].

    Adds `scale` times its gradient to `grad`; `feature` [n^3, 2, L] is work space.
    """
    loss.zero_()
    n = cube.shape[0]
    if layout.levels == 0 or n == 0:
        return
    B = block_size(BLOCK, params)
    blocks = (triton.cdiv(n**3, B),)
    sizes = {"L": layout.levels, "LP": layout.padded_levels, "B": B}
    _gather[blocks](params, layout.ints, layout.floats, cube, n, feature, **sizes)
    _backward[blocks](
        *grad, layout.ints, layout.floats, cube, n, feature, scale, loss, **sizes
    )  # fmt: skip


@triton.jit
def _gather(
    parameters, ints, floats, cube, n, feature, L: tl.constexpr, LP: tl.constexpr, B: tl.constexpr
):
    k = tl.program_id(0) * B + tl.arange(0, B)
    on = k < n * n * n
    x, y, z, live = relative_position(cube, floats, k, on)
    f0, f1 = gather_hash(parameters, ints, floats, x, y, z, live, L, LP)
    level = tl.arange(0, LP)[None, :]
    target = feature + k[:, None] * (2 * L) + level
    mask = on[:, None] & (level < L)
    tl.store(target, f0, mask=mask)
    tl.store(target + L, f1, mask=mask)


@triton.jit
def _backward(
    values, touched, ints, floats, cube, n, feature, scale, loss,
    L: tl.constexpr, LP: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    k = tl.program_id(0) * B + tl.arange(0, B)
    on = k < n * n * n
    x, y, z, live = relative_position(cube, floats, k, on)
    total = tl.zeros([B, LP], tl.float32)
    d0 = tl.zeros([B, LP], tl.float32)
    d1 = tl.zeros([B, LP], tl.float32)
    for axis in tl.static_range(3):
        stride = n * n if axis == 0 else (n if axis == 1 else 1)
        i = k // stride % n
        lower0, lower1 = _difference(feature, k, stride, on & (i > 0), L, LP)
        upper0, upper1 = _difference(feature, k, -stride, on & (i < n - 1), L, LP)
        total += upper0 * upper0 + upper1 * upper1
        d0 += lower0 + upper0
        d1 += lower1 + upper1
    vertices = 1.0 * n * n * n
    tl.atomic_add(loss, tl.sum(tl.sum(total, axis=1), axis=0) / vertices, sem="relaxed")
    norm = 2.0 * scale / vertices
    scatter_hash(values, touched, ints, floats, x, y, z, live, norm * d0, norm * d1, L, LP)


@triton.jit
def _difference(feature, k, back, on, L: tl.constexpr, LP: tl.constexpr):
    """Features of vertex k minus those of vertex k - back, [B, LP] each; 0 unless `on` [B]."""
    level = tl.arange(0, LP)[None, :]
    mask = on[:, None] & (level < L)
    here = feature + k[:, None] * (2 * L) + level
    there = feature + (k - back)[:, None] * (2 * L) + level
    e0 = tl.load(here, mask=mask, other=0.0) - tl.load(there, mask=mask, other=0.0)
    e1 = tl.load(here + L, mask=mask, other=0.0) - tl.load(there + L, mask=mask, other=0.0)
    return e0, e1
