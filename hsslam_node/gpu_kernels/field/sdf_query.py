"""SDF and its spatial gradient at any points on the GPU, for the tracker and the mesher.

Twin: `kernels/field/sdf_query.py`.
"""

import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size
from hsslam_node.gpu_kernels.field.decoder import (
    add_one_blob,
    hash_rows,
    one_blob_position_gradient,
    relative_position,
    weight_rows,
)
from hsslam_node.gpu_kernels.field.forward import tanh
from hsslam_node.gpu_kernels.field.hash_grid import gather_hash, hash_position_gradient
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.gpu_kernels.field.planes import gather_planes, plane_position_gradient

BLOCK, WARPS = 16, 8  # of one program: points (a frame has few), warps (else registers spill)


def query_sdf(
    params: Tensor,
    layout: GpuLayout,
    points: Tensor,
    sdf: Tensor,
    inside: Tensor,
    gradient: Tensor,
    want_gradient: bool,
) -> None:
    """SDF [N] in units of T at points [N, 3] (m, world) and, if wanted, gradient [N, 3] (T/m).

    Reads the geometry prefix of `params` only. Outside the bound: sdf 1, inside (uint8) 0, gradient 0.
    """
    n = points.shape[0]
    if n == 0:
        return
    B = block_size(BLOCK, params)
    _query_sdf[(triton.cdiv(n, B),)](
        params, layout.ints, layout.floats, points, n, sdf, inside, gradient,
        GRADIENT=want_gradient, C=layout.channels, L=layout.levels, LP=layout.padded_levels,
        BLOBS=layout.blob_rows, B=B, num_warps=WARPS,
    )  # fmt: skip


@triton.jit(do_not_specialize=["n"])
def _query_sdf(
    parameters, ints, floats, points, n, sdf, inside, gradient, GRADIENT: tl.constexpr,
    C: tl.constexpr, L: tl.constexpr, LP: tl.constexpr, BLOBS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    k = tl.program_id(0) * B + tl.arange(0, B)
    on = k < n
    x, y, z, live = relative_position(points, floats, k, on)
    phi, gx, gy, gz = sdf_and_gradient(
        parameters, ints, floats, x, y, z, live, GRADIENT, C, L, LP, BLOBS
    )
    tl.store(sdf + k, phi, mask=on)
    tl.store(inside + k, live.to(tl.uint8), mask=on)
    if GRADIENT:
        tl.store(gradient + 3 * k, gx, mask=on)
        tl.store(gradient + 3 * k + 1, gy, mask=on)
        tl.store(gradient + 3 * k + 2, gz, mask=on)


@triton.jit
def sdf_and_gradient(
    params, ints, floats, x, y, z, live, GRADIENT: tl.constexpr,
    C: tl.constexpr, L: tl.constexpr, LP: tl.constexpr, BLOBS: tl.constexpr,
):  # fmt: skip
    """SDF [B] and its gradient, three [B] (T/m; 0 unless GRADIENT), at positions x, y, z [B]."""
    W1 = params + tl.load(ints)
    width: tl.constexpr = 2 * L + 2 * C
    hidden = tl.zeros([x.shape[0], 32], tl.float32)
    if L > 0:
        f0, f1 = gather_hash(params, ints, floats, x, y, z, live, L, LP)
        hidden = tl.dot(f0, hash_rows(W1, 0, L, LP), hidden, input_precision="ieee")
        hidden = tl.dot(f1, hash_rows(W1, 1, L, LP), hidden, input_precision="ieee")
    if C > 0:
        for s in tl.static_range(2):
            f = gather_planes(params, ints, floats, s, x, y, z, live, C)
            rows = weight_rows(W1, 2 * L + s * C, C)
            hidden = tl.dot(f, rows, hidden, input_precision="ieee")
    if BLOBS > 0:
        hidden = add_one_blob(W1, width, floats, x, y, z, hidden)
    w2 = tl.load(params + tl.load(ints + 1) + 16 * tl.arange(0, 32))[None, :]  # the SDF's column
    phi = tanh(tl.sum(tl.maximum(hidden, 0.0) * w2, axis=1))
    gx = tl.zeros_like(x)
    gy = tl.zeros_like(x)
    gz = tl.zeros_like(x)
    if GRADIENT:
        slope = tl.where(live, 1.0 - phi * phi, 0.0)
        d_hidden = tl.where(hidden > 0.0, slope[:, None] * w2, 0.0)
        if L > 0:
            d0 = tl.dot(d_hidden, tl.trans(hash_rows(W1, 0, L, LP)), input_precision="ieee")
            d1 = tl.dot(d_hidden, tl.trans(hash_rows(W1, 1, L, LP)), input_precision="ieee")
            ex, ey, ez = hash_position_gradient(
                params, ints, floats, x, y, z, live, d0, d1, L, LP
            )  # fmt: skip
            gx += ex
            gy += ey
            gz += ez
        if C > 0:
            for s in tl.static_range(2):
                rows = tl.trans(weight_rows(W1, 2 * L + s * C, C))
                d = tl.dot(d_hidden, rows, input_precision="ieee")
                ex, ey, ez = plane_position_gradient(
                    params, ints, floats, s, x, y, z, live, d, C
                )  # fmt: skip
                gx += ex
                gy += ey
                gz += ez
        if BLOBS > 0:
            ex, ey, ez = one_blob_position_gradient(W1, width, floats, x, y, z, d_hidden)
            gx += ex
            gy += ey
            gz += ez
    return tl.where(live, phi, 1.0), gx, gy, gz
