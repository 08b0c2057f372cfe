"""Forward pass of the hybrid field on the GPU; stores what the backward pass needs.

Twin: `kernels/field/forward.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size
from hsslam_node.gpu_kernels.field.activations import FieldActivations
from hsslam_node.gpu_kernels.field.decoder import (
    add_one_blob,
    feature_rows,
    hash_rows,
    output_columns,
    relative_position,
    weight_rows,
)
from hsslam_node.gpu_kernels.field.hash_grid import gather_hash
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.gpu_kernels.field.planes import gather_planes

BLOCK, WARPS = 32, 8  # of one program: points, warps (more points would spill registers)


def field_forward(
    params: Tensor, layout: GpuLayout, points: Tensor, n: int, acts: FieldActivations
) -> None:
    """SDF and colour at points[:n] ([N, 3] m, world) into `acts`; outside the bound: sdf 1, grey.

    A nan point is outside.
    """
    if n == 0:
        return
    B = block_size(BLOCK, params)
    _field_forward[(triton.cdiv(n, B),)](
        params, layout.ints, layout.floats, points, n, acts.position, acts.inside,
        acts.geometry_in, acts.geometry_hidden, acts.geometry_out, acts.color_in,
        acts.color_hidden, acts.sdf, acts.rgb, C=layout.channels, L=layout.levels,
        LP=layout.padded_levels, BLOBS=layout.blob_rows, B=B, num_warps=WARPS,
    )  # fmt: skip


@triton.jit(do_not_specialize=["n"])
def _field_forward(
    parameters, ints, floats, points, n, position, inside, geometry_in, geometry_hidden, geometry_out,
    color_in, color_hidden, sdf, rgb, C: tl.constexpr, L: tl.constexpr, LP: tl.constexpr,
    BLOBS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    k = tl.program_id(0) * B + tl.arange(0, B)
    on = k < n
    row = k[:, None]
    x, y, z, live = relative_position(points, floats, k, on)
    tl.store(position + 3 * k, x, mask=on)
    tl.store(position + 3 * k + 1, y, mask=on)
    tl.store(position + 3 * k + 2, z, mask=on)
    tl.store(inside + k, live.to(tl.uint8), mask=on)

    W1 = parameters + tl.load(ints)
    width: tl.constexpr = 2 * L + 2 * C
    hidden = tl.zeros([B, 32], tl.float32)
    if L > 0:
        f0, f1 = gather_hash(parameters, ints, floats, x, y, z, live, L, LP)
        hidden = tl.dot(f0, hash_rows(W1, 0, L, LP), hidden, input_precision="ieee")
        hidden = tl.dot(f1, hash_rows(W1, 1, L, LP), hidden, input_precision="ieee")
        level = tl.arange(0, LP)[None, :]
        target = geometry_in + row * width + 2 * level
        tl.store(target, f0, mask=on[:, None] & (level < L))
        tl.store(target + 1, f1, mask=on[:, None] & (level < L))
    if C > 0:
        for s in tl.static_range(2):
            f = gather_planes(parameters, ints, floats, s, x, y, z, live, C)
            rows = weight_rows(W1, 2 * L + s * C, C)
            hidden = tl.dot(f, rows, hidden, input_precision="ieee")
            target = geometry_in + row * width + 2 * L + s * C + tl.arange(0, C)[None, :]
            tl.store(target, f, mask=on[:, None])
    if BLOBS > 0:
        hidden = add_one_blob(W1, width, floats, x, y, z, hidden)
    hidden = tl.maximum(hidden, 0.0)
    unit = tl.arange(0, 32)[None, :]
    tl.store(geometry_hidden + row * 32 + unit, hidden, mask=on[:, None])

    W2 = output_columns(parameters + tl.load(ints + 1), 16)
    out = tl.dot(hidden, W2, input_precision="ieee")
    column = tl.arange(0, 16)[None, :]
    tl.store(geometry_out + row * 16 + column, out, mask=on[:, None])
    distance = tanh(tl.sum(tl.where(column == 0, out, 0.0), axis=1))
    tl.store(sdf + k, tl.where(live, distance, 1.0), mask=on)

    V1 = parameters + tl.load(ints + 2)
    hidden = tl.dot(out, feature_rows(V1, 2 * C + BLOBS), input_precision="ieee")
    if C > 0:
        for s in tl.static_range(2):
            f = gather_planes(parameters, ints, floats, 2 + s, x, y, z, live, C)
            hidden = tl.dot(f, weight_rows(V1, s * C, C), hidden, input_precision="ieee")
            target = color_in + row * (2 * C) + s * C + tl.arange(0, C)[None, :]
            tl.store(target, f, mask=on[:, None])
    if BLOBS > 0:
        hidden = add_one_blob(V1, 2 * C, floats, x, y, z, hidden)
    hidden = tl.maximum(hidden, 0.0)
    tl.store(color_hidden + row * 32 + unit, hidden, mask=on[:, None])
    V2 = output_columns(parameters + tl.load(ints + 3), 3)
    color = tl.sigmoid(tl.dot(hidden, V2, input_precision="ieee"))
    color = tl.where(live[:, None], color, 0.5)
    tl.store(rgb + 3 * row + column, color, mask=on[:, None] & (column < 3))


@triton.jit
def tanh(x):
    """Hyperbolic tangent, to 1e-7."""
    e = tl.exp(-2.0 * tl.abs(x))
    t = (1.0 - e) / (1.0 + e)
    return tl.where(x < 0.0, -t, t)
