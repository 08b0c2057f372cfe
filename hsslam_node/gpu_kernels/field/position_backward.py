"""Backward pass of the field to the sample positions on the GPU.

Twin: `kernels/field/pose_backward.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size
from hsslam_node.gpu_kernels.field.activations import FieldActivations
from hsslam_node.gpu_kernels.field.decoder import load_position, one_blob_position_gradient
from hsslam_node.gpu_kernels.field.hash_grid import hash_position_gradient
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.gpu_kernels.field.planes import plane_position_gradient

BLOCK, WARPS = 32, 8  # of one program: points, warps (more points would spill registers)


def position_backward(
    params: Tensor, layout: GpuLayout, n: int, acts: FieldActivations, d_points: Tensor
) -> None:
    """Write d_points [:n, 3] (1/m), 0 outside the bound; call it after the decoders' backward pass."""
    B = block_size(BLOCK, params)
    _position_backward[(triton.cdiv(n, B),)](
        params, layout.ints, layout.floats, n, acts.position, acts.inside, acts.d_geometry_in,
        acts.d_geometry_hidden, acts.d_color_in, acts.d_color_hidden, d_points,
        C=layout.channels, L=layout.levels, LP=layout.padded_levels, BLOBS=layout.blob_rows,
        B=B, num_warps=WARPS,
    )  # fmt: skip


@triton.jit(do_not_specialize=["n"])
def _position_backward(
    parameters, ints, floats, n, position, inside, d_geometry_in, d_geometry_hidden, d_color_in,
    d_color_hidden, d_points, C: tl.constexpr, L: tl.constexpr, LP: tl.constexpr,
    BLOBS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    k = tl.program_id(0) * B + tl.arange(0, B)
    row = k[:, None]
    on = k < n
    live = tl.load(inside + k, mask=on, other=0) != 0
    x, y, z = load_position(position, k, live)
    width: tl.constexpr = 2 * L + 2 * C
    dx = tl.zeros([B], tl.float32)
    dy = tl.zeros([B], tl.float32)
    dz = tl.zeros([B], tl.float32)
    if L > 0:
        level = tl.arange(0, LP)[None, :]
        source = d_geometry_in + row * width + 2 * level
        d0 = tl.load(source, mask=live[:, None] & (level < L), other=0.0)
        d1 = tl.load(source + 1, mask=live[:, None] & (level < L), other=0.0)
        ex, ey, ez = hash_position_gradient(
            parameters, ints, floats, x, y, z, live, d0, d1, L, LP
        )  # fmt: skip
        dx += ex
        dy += ey
        dz += ez
    if C > 0:
        channel = tl.arange(0, C)[None, :]
        for s in tl.static_range(2):
            source = d_geometry_in + row * width + 2 * L + s * C + channel
            d = tl.load(source, mask=live[:, None], other=0.0)
            ex, ey, ez = plane_position_gradient(parameters, ints, floats, s, x, y, z, live, d, C)
            dx += ex
            dy += ey
            dz += ez
            source = d_color_in + row * (2 * C) + s * C + channel
            d = tl.load(source, mask=live[:, None], other=0.0)
            ex, ey, ez = plane_position_gradient(
                parameters, ints, floats, 2 + s, x, y, z, live, d, C
            )
            dx += ex
            dy += ey
            dz += ez
    if BLOBS > 0:
        unit = tl.arange(0, 32)[None, :]
        d = tl.load(d_geometry_hidden + row * 32 + unit, mask=live[:, None], other=0.0)
        W1 = parameters + tl.load(ints)
        ex, ey, ez = one_blob_position_gradient(W1, width, floats, x, y, z, d)
        dx += ex
        dy += ey
        dz += ez
        d = tl.load(d_color_hidden + row * 32 + unit, mask=live[:, None], other=0.0)
        V1 = parameters + tl.load(ints + 2)
        ex, ey, ez = one_blob_position_gradient(V1, 2 * C, floats, x, y, z, d)
        dx += ex
        dy += ey
        dz += ez
    tl.store(d_points + 3 * k, dx, mask=on)
    tl.store(d_points + 3 * k + 1, dy, mask=on)
    tl.store(d_points + 3 * k + 2, dz, mask=on)
