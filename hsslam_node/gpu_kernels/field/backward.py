"""Backward pass of the hybrid field on the GPU: to the parameters, and to the sample positions.

Twin: `kernels/field/backward.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size
from hsslam_node.gpu_kernels.field.activations import FieldActivations, Gradient
from hsslam_node.gpu_kernels.field.decoder import load_position
from hsslam_node.gpu_kernels.field.decoder_backward import color_backward, geometry_backward
from hsslam_node.gpu_kernels.field.hash_grid import scatter_hash
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.gpu_kernels.field.planes import scatter_plane
from hsslam_node.gpu_kernels.field.position_backward import position_backward

BLOCK = 32  # points of one program


def field_backward(
    params: Tensor,
    layout: GpuLayout,
    n: int,
    acts: FieldActivations,
    d_sdf: Tensor,
    d_rgb: Tensor,
    grad: Gradient,
    d_points: Tensor,
    want_points: bool,
) -> None:
    """Add the parameter gradient to `grad`; if `want_points`, write d_points [N, 3] (1/m).

    `acts` as `field_forward` left it for the first n points; d_sdf [N], d_rgb [N, 3] are the loss
    gradients. Points outside the bound contribute nothing and mark nothing.
    """
    grad.touched[layout.first_decoder_chunk : layout.last_decoder_chunk + 1].fill_(1)
    if n == 0:
        return
    B = block_size(BLOCK, params)
    blocks = triton.cdiv(n, B)
    tables, sizes = (layout.ints, layout.floats), {"C": layout.channels, "L": layout.levels}
    color_backward(params, layout, n, acts, d_rgb, grad)
    geometry_backward(params, layout, n, acts, d_sdf, grad)
    if layout.channels:
        _scatter_planes[(blocks, 12)](
            *grad, *tables, n, acts.position, acts.inside, acts.d_geometry_in, acts.d_color_in,
            **sizes, B=B,
        )  # fmt: skip
    if layout.levels:
        _scatter_hash[(blocks,)](
            *grad, *tables, n, acts.position, acts.inside, acts.d_geometry_in, **sizes,
            LP=layout.padded_levels, B=B,
        )  # fmt: skip
    if want_points:
        position_backward(params, layout, n, acts, d_points)


@triton.jit(do_not_specialize=["n"])
def _scatter_planes(
    values, touched, ints, floats, n, position, inside, d_geometry_in, d_color_in,
    C: tl.constexpr, L: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """One program: a block of points and one of the twelve planes."""
    k = tl.program_id(0) * B + tl.arange(0, B)
    on = k < n
    live = tl.load(inside + k, mask=on, other=0) != 0
    plane = tl.program_id(1)
    u = tl.load(position + 3 * k + tl.where(plane % 3 == 2, 1, 0), mask=live, other=0.0)
    v = tl.load(position + 3 * k + tl.where(plane % 3 == 0, 1, 2), mask=live, other=0.0)
    column = plane // 3 % 2 * C + tl.arange(0, C)[None, :]
    if plane < 6:
        source = d_geometry_in + k[:, None] * (2 * L + 2 * C) + 2 * L + column
        d = tl.load(source, mask=live[:, None], other=0.0)
    else:
        d = tl.load(d_color_in + k[:, None] * (2 * C) + column, mask=live[:, None], other=0.0)
    scatter_plane(values, touched, ints, floats, plane, u, v, live, d, C)


@triton.jit(do_not_specialize=["n"])
def _scatter_hash(
    values, touched, ints, floats, n, position, inside, d_geometry_in,
    C: tl.constexpr, L: tl.constexpr, LP: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    k = tl.program_id(0) * B + tl.arange(0, B)
    live = tl.load(inside + k, mask=k < n, other=0) != 0
    x, y, z = load_position(position, k, live)
    level = tl.arange(0, LP)[None, :]
    source = d_geometry_in + k[:, None] * (2 * L + 2 * C) + 2 * level
    on = live[:, None] & (level < L)
    d0 = tl.load(source, mask=on, other=0.0)
    d1 = tl.load(source + 1, mask=on, other=0.0)
    scatter_hash(values, touched, ints, floats, x, y, z, live, d0, d1, L, LP)
