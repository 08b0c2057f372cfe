"""Textures of floors and walls in dwellings."""

import numpy as np

from hsslam_node.synth.textures.noise_pattern import fractal_noise, grid_m, mix

Rng = np.random.Generator
Shape = tuple[int, int]


def tiles(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """Glazed tiles of 20 cm with joints, each of its own tone, some with an ornament."""
    x, y = grid_m(shape, texel_m)
    column, row = np.floor(x / 0.2).astype(int), np.floor(y / 0.2).astype(int)
    tone = rng.uniform(-1, 1, (int(row.max()) + 1, int(column.max()) + 1)).astype(np.float32)
    px, py = x / 0.2 - column - 0.5, y / 0.2 - row - 0.5  # [-0.5, 0.5]
    image = color * (1 + 0.13 * tone[row, column])[..., None]
    star = np.cos(8 * np.arctan2(py, px)) * 0.06 + 0.30
    ornament = (np.abs(np.hypot(px, py) - star) < 0.035) * (tone[row, column] > 0.2)
    image = mix(image, np.clip(color * 0.45, 0, 1), 0.8 * ornament)
    image *= (1 + 0.08 * fractal_noise(shape, texel_m, rng, 0.25, 0.008, 0.8))[..., None]
    joint = 0.5 - np.maximum(np.abs(px), np.abs(py))
    return mix(np.array([0.45, 0.43, 0.40]), image, (joint - 0.012) / 0.015)


def parquet(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """Squares of 42 cm of six staves each, laid in turn along and across."""
    x, y = grid_m(shape, texel_m)
    column, row = np.floor(x / 0.42).astype(int), np.floor(y / 0.42).astype(int)
    px, py = x - 0.42 * column + 0 * y, y - 0.42 * row + 0 * x
    across = (column + row) % 2 == 0
    stave_m = np.where(across, px, py)
    stave = np.minimum(np.floor(stave_m / 0.07).astype(int), 5)
    tone = rng.uniform(-1, 1, (int(row.max()) + 1, int(column.max()) + 1, 6)).astype(np.float32)
    grain = np.where(
        across,
        fractal_noise((shape[1], shape[0]), texel_m, rng, 0.06, 0.006, 0.85, stretch=8).T,
        fractal_noise(shape, texel_m, rng, 0.06, 0.006, 0.85, stretch=8),
    )
    image = color * (1 + 0.24 * tone[row, column, stave] + 0.20 * grain)[..., None]
    image *= (1 + 0.07 * fractal_noise(shape, texel_m, rng, 0.6, 0.02))[..., None]
    gap = np.minimum(stave_m - 0.07 * stave, 0.07 * (stave + 1) - stave_m)
    end = np.where(across, np.minimum(py, 0.42 - py), np.minimum(px, 0.42 - px))
    return mix(image * 0.4, image, (np.minimum(gap, end) - 0.001) / 0.004)


def stripes(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """Striped wallpaper with sprigs, darker below a border at the height of a chair's back."""
    x, y = grid_m(shape, texel_m)
    light = np.clip(color * 1.25 + 0.06, 0, 1)
    image = mix(light, color * 0.8, ((x / 0.16) % 1.0 < 0.5) * 0.8 + 0 * y)
    image = mix(image, color * 0.4, (np.abs((x / 0.16) % 1.0 - 0.25) < 0.03) + 0 * y)
    row = np.floor(y / 0.24)
    px = ((x / 0.32 + 0.5 * (row % 2)) % 1.0 - 0.75) * 0.32
    py = (y / 0.24 - row - 0.5) * 0.24
    a = np.arctan2(py, px) + rng.uniform(0, 6)
    image = mix(image, color * 0.35, np.hypot(px, py) < 0.020 + 0.022 * np.cos(2.5 * a) ** 2)
    below_m = shape[0] * texel_m - y + 0 * x  # above the floor
    image = np.where((below_m < 0.95)[..., None], image * 0.62, image)
    image = mix(image, color * 0.25, np.abs(below_m - 0.95) < 0.03)
    return image * (1 + 0.09 * fractal_noise(shape, texel_m, rng, 0.9, 0.01, 0.75))[..., None]


def keys(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """The keys of a piano, across."""
    x, y = grid_m(shape, texel_m)
    key = x / 0.0235
    white = np.full((*shape, 3), 0.88, np.float32) * (1 - 0.7 * (key % 1.0 < 0.12))[..., None]
    black = (np.abs(key % 1.0 - 1.0) < 0.3) | (key % 1.0 < 0.3)
    black = black & np.isin(np.round(key).astype(int) % 7, (1, 2, 4, 5, 6))
    return mix(white, np.array([0.05, 0.05, 0.06]), black & (y < 0.65 * shape[0] * texel_m))


def paint(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """Painted plaster: what a roller leaves, and a few faint marks."""
    tone = 0.025 * fractal_noise(shape, texel_m, rng, 1.6, 0.008, 0.9)
    scuffs = fractal_noise(shape, texel_m, rng, 0.4, 0.01, 0.7, stretch=3)
    return color * (1 + tone - 0.05 * np.clip(scuffs - 0.9, 0, 1))[..., None]


def lino(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """Linoleum: fine speckle, seams every two metres."""
    x, _ = grid_m(shape, texel_m)
    speckle = 0.07 * fractal_noise(shape, texel_m, rng, 0.05, 0.004, 0.95)
    seam = np.abs((x / 2.0) % 1.0 - 0.5) < 0.002
    return color * (1 + speckle - 0.3 * seam)[..., None]


def glow(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """The glass of a lamp that is on."""
    return np.full((*shape, 3), 0.97, np.float32)
