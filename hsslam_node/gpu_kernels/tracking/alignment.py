"""Normal equations of depth points on the zero level of the map, on the GPU: two launches a step.

Twin: `kernels/tracking/alignment.py`.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size
from hsslam_node.gpu_kernels.field.decoder import world_position
from hsslam_node.gpu_kernels.field.layout import GpuLayout
from hsslam_node.gpu_kernels.field.sdf_query import sdf_and_gradient

BLOCK, WARPS = 16, 8  # of one program: points (a frame has few), warps (else registers spill)


def alignment_work_space(layout: GpuLayout, point_count: int) -> Tensor:
    """Allocate `partial` for up to `point_count` points: one system for each block of points."""
    blocks = triton.cdiv(max(point_count, 1), block_size(BLOCK, layout.ints))
    return torch.zeros((blocks, 64), dtype=torch.float32, device=layout.device)


def sdf_normal_equations(
    params: Tensor,
    layout: GpuLayout,
    points: Tensor,
    point_count: Tensor,
    T_world_cam: Tensor,
    truncation_m: float,
    sigma_m: float,
    sigma_slope: float,
    huber_m: float,
    partial: Tensor,
    H: Tensor,
    b: Tensor,
    sums: Tensor,
) -> None:
    """Linearise the SDF term about T_world_cam [3, 4]; twin of `kernels.tracking.alignment.add_sdf_term`.

    Residual T phi, weight 1 / sigma(z)^2, Huber; |phi| > 0.95 is an outlier. The first `point_count`
    [1] int32 of points [N, 3] (m, camera) count. Writes H [7, 7] (both triangles) and b [7], float64,
    in (translation, rotation, grey bias), the last row 0; and sums [4] float64: weighted squared error,
    inliers, points in the bound, sum of squared inlier residuals (m^2). The order of the sums is fixed.
    """
    n = points.shape[0]
    B = block_size(BLOCK, params)
    blocks = triton.cdiv(n, B)
    if n:
        _linearise[(blocks,)](
            params, layout.ints, layout.floats, points, point_count, n, T_world_cam, truncation_m,
            sigma_m, sigma_slope, huber_m, partial, C=layout.channels, L=layout.levels,
            LP=layout.padded_levels, BLOBS=layout.blob_rows, B=B,
            num_warps=WARPS,
        )  # fmt: skip
    _add_up[(1,)](partial, blocks, H, b, sums, B=16)


@triton.jit(do_not_specialize=["n"], do_not_specialize_on_alignment=["point_count"])
def _linearise(
    parameters, ints, floats, points, point_count, n, pose, T, sigma_m, sigma_slope, huber, partial,
    C: tl.constexpr, L: tl.constexpr, LP: tl.constexpr, BLOBS: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """partial [8, 8] of a block: w a a^T with a = (6 of J, residual, 0), and four sums in its last row."""
    k = tl.program_id(0) * B + tl.arange(0, B)
    on = k < tl.minimum(tl.load(point_count), n)
    wx, wy, wz, x, y, z, live = world_position(points, pose, floats, k, on)
    phi, gx, gy, gz = sdf_and_gradient(
        parameters, ints, floats, x, y, z, live, True, C, L, LP, BLOBS
    )
    used = live & (tl.abs(phi) <= 0.95)
    r = tl.where(used, phi * T, 0.0)
    far = tl.maximum(tl.load(points + 3 * k + 2, mask=on, other=0.0) - 0.4, 0.0)
    sigma = sigma_m + sigma_slope * far * far
    weight = tl.where(used, 1.0 / (sigma * sigma), 0.0)
    size = tl.abs(r)
    heavy = size > huber
    cost = weight * tl.where(heavy, huber * (2.0 * size - huber), r * r)
    weight = tl.where(heavy, weight * huber / tl.maximum(size, 1e-12), weight)
    inlier = used & (size <= huber)

    gx *= T
    gy *= T
    gz *= T
    dx = wx - tl.load(pose + 3)
    dy = wy - tl.load(pose + 7)
    dz = wz - tl.load(pose + 11)
    column = tl.arange(0, 16)[None, :]
    a = tl.where(column == 0, gx[:, None], 0.0)
    a = tl.where(column == 1, gy[:, None], a)
    a = tl.where(column == 2, gz[:, None], a)
    a = tl.where(column == 3, (dy * gz - dz * gy)[:, None], a)
    a = tl.where(column == 4, (dz * gx - dx * gz)[:, None], a)
    a = tl.where(column == 5, (dx * gy - dy * gx)[:, None], a)
    a = tl.where(column == 6, r[:, None], a)
    a = tl.where(used[:, None], a, 0.0)
    system = tl.dot(tl.trans(a * weight[:, None]), a, input_precision="ieee")
    row = tl.arange(0, 16)[:, None]
    target = partial + 64 * tl.program_id(0)
    tl.store(target + 8 * row + column, system, mask=(row < 7) & (column < 8))
    tl.store(target + 56, tl.sum(cost, axis=0))
    tl.store(target + 57, tl.sum(inlier.to(tl.float32), axis=0))
    tl.store(target + 58, tl.sum(live.to(tl.float32), axis=0))
    tl.store(target + 59, tl.sum(tl.where(inlier, r * r, 0.0), axis=0))


@triton.jit(do_not_specialize=["blocks"])
def _add_up(partial, blocks, H, b, sums, B: tl.constexpr):
    k = tl.arange(0, 64)
    total = tl.zeros([64], tl.float64)
    for start in range(0, blocks, B):
        block = start + tl.arange(0, B)[:, None]
        part = tl.load(partial + 64 * block + k[None, :], mask=block < blocks, other=0.0)
        total += tl.sum(part.to(tl.float64), axis=0)
    row = k // 8
    column = k % 8
    in_system = (row < 6) & (column < 6)
    inside = (row < 7) & (column < 7)
    tl.store(H + 7 * row + column, tl.where(in_system, total, 0.0), mask=inside)
    tl.store(b + row, tl.where(row < 6, total, 0.0), mask=(row < 7) & (column == 6))
    tl.store(sums + column, total, mask=(row == 7) & (column < 4))
