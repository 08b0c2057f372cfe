"""What a mapping step needs beside rays; the same on every device, drawn with the same random numbers."""

from functools import lru_cache

import numpy as np
import torch

from hsslam_node.config import MapperConfig
from hsslam_node.field.layout import FieldLayout
from hsslam_node.losses.patch import random_patches, window_rays


def ray_weights(depth: np.ndarray, config: MapperConfig) -> np.ndarray:
    """Weight [R] float32 of the depth and SDF terms of rays with this depth [R], m."""
    noise = config.depth_noise_m
    return (1.0 / (1.0 + (noise * depth * depth / 0.01) ** 2)).astype(np.float32)


def patch_windows(rays: int, config: MapperConfig, generator: np.random.Generator) -> np.ndarray:
    """Ray indices [W, k^2] int64 of the windows of random patches; W = 0 where rays are too few."""
    k = config.patch_kernel_px
    patches = random_patches(rays, config.patch_repeats, generator)
    if len(patches) == 0:
        return np.zeros((0, k * k), np.int64)
    places = _window_places(patches.shape[1], k, config.patch_stride_px)
    return patches.reshape(len(patches), -1)[:, places].reshape(-1, k * k)


@lru_cache(maxsize=64)
def _window_places(side: int, kernel: int, stride: int) -> np.ndarray:
    """Places [W, k^2] in a patch, row by row, of its windows; a handful of sides occurs in a run."""
    places = torch.arange(side * side).reshape(1, side, side)
    return window_rays(places, kernel, stride).numpy()


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
