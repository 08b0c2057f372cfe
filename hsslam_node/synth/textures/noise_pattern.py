"""Smooth random patterns, the raw material of the textures."""

import cv2
import numpy as np


def value_noise(
    shape: tuple[int, int], cell: tuple[float, float], rng: np.random.Generator
) -> np.ndarray:
    """Smooth random values in about [-1, 1], [h, w] float32; cell (down, across) in texels."""
    h, w = shape
    down, across = (max(c, 1.0) for c in cell)
    rows, columns = int(np.ceil(h / down)) + 3, int(np.ceil(w / across)) + 3
    grid = rng.uniform(-1.0, 1.0, (rows, columns)).astype(np.float32)
    size = max(round(columns * across), w), max(round(rows * down), h)
    big = cv2.resize(grid, size, interpolation=cv2.INTER_CUBIC)
    y, x = rng.integers(0, size[1] - h + 1), rng.integers(0, size[0] - w + 1)
    return big[y : y + h, x : x + w]


def fractal_noise(
    shape: tuple[int, int],
    texel_m: float,
    rng: np.random.Generator,
    coarsest_m: float = 0.6,
    finest_m: float = 0.008,
    gain: float = 0.62,
    stretch: float = 1.0,
) -> np.ndarray:
    """Octaves of noise from coarsest to finest cell, [h, w] float32, standard deviation about 0.5.

    `stretch` > 1 makes the pattern longer across (wood grain).
    """
    total = np.zeros(shape, np.float32)
    cell_m, amplitude = coarsest_m, 1.0
    while cell_m >= max(finest_m, texel_m):
        down, across = cell_m / texel_m, cell_m * stretch / texel_m
        if down < shape[0] and across < 4 * shape[1]:
            total += np.float32(amplitude) * value_noise(shape, (down, min(across, shape[1])), rng)
        cell_m, amplitude = cell_m / 2, amplitude * gain
    deviation = float(total.std())
    return total * np.float32(0.5 / deviation) if deviation > 1e-6 else total


def grid_m(shape: tuple[int, int], texel_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Texel centres in metres: x [1, w] across and y [h, 1] down."""
    h, w = shape
    x = (np.arange(w, dtype=np.float32) + 0.5) * texel_m
    y = (np.arange(h, dtype=np.float32) + 0.5) * texel_m
    return x[None, :], y[:, None]


def mix(a: np.ndarray, b: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """a [3] or [h, w, 3] towards b by weight [h, w], clipped to [0, 1]."""
    weight = np.clip(weight, 0.0, 1.0)[..., None]
    return (np.asarray(a, np.float32) * (1 - weight) + np.asarray(b, np.float32) * weight).astype(
        np.float32
    )
