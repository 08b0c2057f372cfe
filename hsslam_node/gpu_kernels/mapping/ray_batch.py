"""Rays of a mapping batch on the GPU: their samples, and the gradient by the poses.

Twin: `kernels/mapping/ray_batch.py`.
"""

from typing import NamedTuple

import torch
import triton
import triton.language as tl
from torch import Tensor

from hsslam_node.gpu_kernels.block_size import block_size

BLOCK = 8  # rays of one program


class GpuRays(NamedTuple):
    """Tensors for up to R rays; `slot` numbers the keyframes of the batch."""

    direction: Tensor  # [R, 3] float32, camera frame, z = 1
    depth: Tensor  # [R] float32 m, planar
    color: Tensor  # [R, 3] float32 0..1
    slot: Tensor  # [R] int32


def gpu_rays(rays: int, device: torch.device | str) -> GpuRays:
    """An empty batch on the device."""

    def zeros(*shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
        return torch.zeros(shape, dtype=dtype, device=device)

    return GpuRays(zeros(rays, 3), zeros(rays), zeros(rays, 3), zeros(rays, dtype=torch.int32))


def place_samples(
    rays: GpuRays,
    ray_count: Tensor,
    poses: Tensor,
    jitter: Tensor,
    free_samples: int,
    surface_samples: int,
    free_reach: float,
    surface_half_m: float,
    z: Tensor,
    points: Tensor,
) -> None:
    """Sample depths z [R, S] m, sorted near to far, and points [R * S, 3] m, world.

    poses [slots, 3, 4] T_world_cam; jitter [R, S] in 0..1 places each sample within its stratum
    (rendering/ray_sampling.py: free strata over [0, reach D], surface strata over D +- half; a ray without
    measurement, whose depth is -far, has all strata over [0, far]). Rays beyond `ray_count` [1] int32 get
    nan points, which the field treats as outside.
    """
    R, S = z.shape
    B = block_size(BLOCK, z)
    _place_samples[(triton.cdiv(R, B),)](
        rays.direction, rays.depth, rays.slot, ray_count, R, poses, jitter, free_reach,
        surface_half_m, z, points, FREE=free_samples, SURFACE=surface_samples,
        SP=triton.next_power_of_2(S), B=B, enable_fp_fusion=False,
    )  # fmt: skip


def pose_gradients(
    rays: GpuRays, ray_count: Tensor, poses: Tensor, z: Tensor, d_points: Tensor, d_twist: Tensor
) -> None:
    """Add the loss gradient by a world-side twist of each pose to d_twist [slots, 6] (1/m, 1/rad).

    The pose moves as T <- exp(xi) about the camera centre: translation in world axes, rotation in
    world axes about the camera's position. d_points [R * S, 3]; the first `ray_count` rays count.
    """
    R, S = z.shape
    B = block_size(BLOCK, z)
    _pose_gradients[(triton.cdiv(R, B),)](
        rays.direction, rays.slot, ray_count, R, S, poses, z, d_points, d_twist,
        SP=triton.next_power_of_2(S), B=B,
    )  # fmt: skip


@triton.jit(do_not_specialize=["R"])
def _place_samples(
    direction, depth, slot, ray_count, R, poses, jitter, free_reach, half, z, points,
    FREE: tl.constexpr, SURFACE: tl.constexpr, SP: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    S: tl.constexpr = FREE + SURFACE
    r = tl.program_id(0) * B + tl.arange(0, B)
    real = r < tl.minimum(tl.load(ray_count), R)
    s = tl.arange(0, SP)[None, :]
    on = (r < R)[:, None] & (s < S)
    D = tl.load(depth + r, mask=real, other=0.0)[:, None]
    place = tl.load(jitter + r[:, None] * S + s, mask=on, other=0.0)
    value = _sample_depth(s, place, D, free_reach, half, FREE, SURFACE)
    rank = tl.zeros([B, SP], tl.int32)
    for other in range(S):
        its_place = tl.load(jitter + r * S + other, mask=r < R, other=0.0)[:, None]
        index = tl.zeros([B, 1], tl.int32) + other
        rival = _sample_depth(index, its_place, D, free_reach, half, FREE, SURFACE)
        # both are rounded alike, as multiplications and additions are not fused
        nearer = (rival < value) | ((rival == value) & (index < s))
        rank += nearer.to(tl.int32)
    k = r[:, None] * S + rank
    tl.store(z + k, value, mask=on)
    dx, dy, pose = _ray(direction, slot, poses, r, real)
    for a in tl.static_range(3):
        along = _along(pose, dx, dy, a, real)[:, None]
        origin = tl.load(pose + 4 * a + 3, mask=real, other=0.0)[:, None]
        p = tl.where(real[:, None], origin + along * value, float("nan"))
        tl.store(points + 3 * k + a, p, mask=on)


@triton.jit
def _sample_depth(s, place, D, free_reach, half, FREE: tl.constexpr, SURFACE: tl.constexpr):
    """Depth of sample s before sorting."""
    index = s.to(tl.float32)
    free = (index + place) / max(FREE, 1) * free_reach * D
    t = (index - FREE + place) / max(SURFACE, 1)
    surface = tl.maximum(D + (2.0 * t - 1.0) * half, 0.0)
    blind = (index + place) / (FREE + SURFACE) * -D
    return tl.where(D < 0.0, blind, tl.where(s < FREE, free, surface))


@triton.jit(do_not_specialize=["R"])
def _pose_gradients(
    direction, slot, ray_count, R, S, poses, z, d_points, d_twist,
    SP: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    r = tl.program_id(0) * B + tl.arange(0, B)
    real = r < tl.minimum(tl.load(ray_count), R)
    s = tl.arange(0, SP)[None, :]
    on = real[:, None] & (s < S)
    k = r[:, None] * S + s
    distance = tl.load(z + k, mask=on, other=0.0)
    dx = tl.load(d_points + 3 * k, mask=on, other=0.0)
    dy = tl.load(d_points + 3 * k + 1, mask=on, other=0.0)
    dz = tl.load(d_points + 3 * k + 2, mask=on, other=0.0)
    lx = tl.sum(distance * dx, axis=1)
    ly = tl.sum(distance * dy, axis=1)
    lz = tl.sum(distance * dz, axis=1)
    u, v, pose = _ray(direction, slot, poses, r, real)
    ax = _along(pose, u, v, 0, real)
    ay = _along(pose, u, v, 1, real)
    az = _along(pose, u, v, 2, real)
    target = d_twist + 6 * tl.load(slot + r, mask=real, other=0)
    tl.atomic_add(target, tl.sum(dx, axis=1), mask=real, sem="relaxed")
    tl.atomic_add(target + 1, tl.sum(dy, axis=1), mask=real, sem="relaxed")
    tl.atomic_add(target + 2, tl.sum(dz, axis=1), mask=real, sem="relaxed")
    tl.atomic_add(target + 3, ay * lz - az * ly, mask=real, sem="relaxed")
    tl.atomic_add(target + 4, az * lx - ax * lz, mask=real, sem="relaxed")
    tl.atomic_add(target + 5, ax * ly - ay * lx, mask=real, sem="relaxed")


@triton.jit
def _ray(direction, slot, poses, r, real):
    """x and y of the rays' directions [B], and pointers to their poses."""
    dx = tl.load(direction + 3 * r, mask=real, other=0.0)
    dy = tl.load(direction + 3 * r + 1, mask=real, other=0.0)
    return dx, dy, poses + 12 * tl.load(slot + r, mask=real, other=0)


@triton.jit
def _along(pose, dx, dy, a: tl.constexpr, real):
    """World axis a of the rays' directions [B]."""
    x = tl.load(pose + 4 * a, mask=real, other=0.0)
    y = tl.load(pose + 4 * a + 1, mask=real, other=0.0)
    return x * dx + y * dy + tl.load(pose + 4 * a + 2, mask=real, other=0.0)
