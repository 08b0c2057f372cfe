"""Inputs of a mapping step besides rays, the same for CPU and GPU: weights, patches, cube, rates."""

import math
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from hsslam_node.config import MapperConfig
from hsslam_node.config.mapping import SMALLEST_PATCH
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.layout import FieldLayout

_KERNEL_SIGMA_PX = 1.5  # of the Gaussian window, as in S3IM


def ray_weights(depth: np.ndarray, config: MapperConfig, blind_color: float) -> np.ndarray:
    """Weight [R] float32 of the depth and SDF terms of rays with depth [R], m, else of their colour term."""
    noise = config.depth_noise_m
    weight = (1.0 / (1.0 + (noise * depth * depth / 0.01) ** 2)).astype(np.float32)
    weight[depth <= 0] = blind_color
    return weight


def keyframe_losses(
    ray_loss: np.ndarray, slot: np.ndarray, depth: np.ndarray, keyframes: int
) -> np.ndarray:
    """Mean loss [keyframes] of the rays with depth of each keyframe; ray_loss, slot, depth: [R]."""
    has_depth = depth > 0
    n = np.maximum(np.bincount(slot[has_depth], minlength=keyframes), 1)
    return np.bincount(slot[has_depth], ray_loss[has_depth], minlength=keyframes) / n


def patch_windows(rays: int, config: MapperConfig, generator: np.random.Generator) -> np.ndarray:
    """Ray indices [W, k^2] int64 of the windows of random patches; W = 0 if rays are too few."""
    k = config.patch_kernel_px
    patches = random_patches(rays, config.patch_repeats, generator)
    if len(patches) == 0 or patches.shape[1] < k:
        return np.zeros((0, k * k), np.int64)
    places = _window_places(patches.shape[1], k, config.patch_stride_px)
    return patches.reshape(len(patches), -1)[:, places].reshape(-1, k * k)


@lru_cache(maxsize=64)
def _window_places(side: int, kernel: int, stride: int) -> np.ndarray:
    """Pixels [W, k^2] of a patch's windows, as indices row by row; cached, as a run has few sides."""
    places = torch.arange(side * side).reshape(1, side, side)
    return window_rays(places, kernel, stride).numpy()


def random_patches(ray_count: int, repeats: int, generator: np.random.Generator) -> np.ndarray:
    """Ray indices [M, side, side] int64 of M random patches, each the largest square of the rays.

    M is 0 below 16 x 16 rays: too few for structure.
    """
    side = math.isqrt(ray_count)
    if side < SMALLEST_PATCH:
        return np.zeros((0, 0, 0), np.int64)
    orders = [generator.permutation(ray_count)[: side * side] for _ in range(repeats)]
    return (
        np.stack(orders).reshape(repeats, side, side) if orders else np.zeros((0, 0, 0), np.int64)
    )


def window_rays(patches: Tensor, kernel: int, stride: int) -> Tensor:
    """Ray indices [W, kernel^2] of all windows of all patches [M, side, side], row by row."""
    windows = patches.unfold(1, kernel, stride).unfold(2, kernel, stride)  # [M, n, n, k, k]
    return windows.reshape(-1, kernel * kernel)


def window_weights(kernel: int) -> Tensor:
    """Gaussian window [kernel^2] float64, sum 1, row by row."""
    offset = torch.arange(kernel, dtype=torch.float64) - kernel // 2
    profile = torch.exp(-(offset**2) / (2 * _KERNEL_SIGMA_PX**2))
    profile = profile / profile.sum()
    return (profile[:, None] * profile[None, :]).flatten()


def smoothness_cube(
    bound: Bound, vertices: int, cell_m: float, generator: np.random.Generator
) -> np.ndarray:
    """Vertices [n, n, n, 3] float32 m of a random cube, clamped to the bound."""
    side_m = (vertices - 1) * cell_m
    slack = np.maximum(bound.extent_m - side_m, 0.0)
    origin = np.asarray(bound.low) + generator.random(3) * slack
    along = origin + np.arange(vertices)[:, None] * cell_m  # [n, 3], each axis by itself
    along = np.clip(along, bound.low, bound.high).astype(np.float32)
    cube = np.empty((vertices, vertices, vertices, 3), np.float32)
    cube[..., 0], cube[..., 1], cube[..., 2] = np.ix_(*along.T)
    return cube


def learning_rates(layout: FieldLayout, config: MapperConfig, factor: float) -> np.ndarray:
    """Regions [4, 3] of the parameters: first float, last float + 1, Adam step times `factor`."""
    blocks = layout.blocks
    hashes = layout.hash_first
    decoders = blocks["geometry_decoder.W1"].offset
    appearance = blocks["appearance_coarse.xy"].offset
    return np.array(
        [
            [0, hashes, config.plane_rate * factor],
            [hashes, decoders, config.hash_rate * factor],
            [decoders, appearance, config.decoder_rate * factor],
            [appearance, layout.parameter_count, config.plane_rate * factor],
        ]
    )
