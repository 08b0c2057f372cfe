"""Procedural textures: a material and a size give an albedo image with detail at many scales."""

from collections.abc import Callable

import cv2
import numpy as np

from hsslam_node.synth.textures.coverings import glow, keys, lino, paint, parquet, stripes, tiles
from hsslam_node.synth.textures.noise_pattern import fractal_noise, grid_m, mix, value_noise
from hsslam_node.synth.textures.pictures import book_spine, painting, poster, screen, window

Rng = np.random.Generator
Shape = tuple[int, int]


def make_texture(material: str, shape: Shape, texel_m: float, rng: Rng) -> np.ndarray:
    """Albedo [h, w, 3] float32 in [0, 1] of a material such as `wood` or `fabric:teal`.

    Raises:
        KeyError: no such material or colour.
    """
    name, _, tint = material.partition(":")
    color = np.array(COLORS[tint], np.float32) if tint else rng.uniform(0.2, 0.75, 3)
    image = _MATERIALS[name](shape, texel_m, rng, color)
    return np.clip(image, 0.02, 0.98).astype(np.float32)


COLORS = {
    "oak": (0.62, 0.44, 0.26),
    "walnut": (0.36, 0.23, 0.14),
    "pine": (0.78, 0.62, 0.40),
    "white": (0.86, 0.85, 0.82),
    "cream": (0.88, 0.81, 0.66),
    "sage": (0.60, 0.68, 0.55),
    "teal": (0.16, 0.42, 0.44),
    "navy": (0.15, 0.22, 0.40),
    "mustard": (0.80, 0.60, 0.16),
    "terracotta": (0.70, 0.36, 0.24),
    "rose": (0.72, 0.45, 0.46),
    "grey": (0.48, 0.49, 0.50),
    "charcoal": (0.20, 0.20, 0.22),
    "red": (0.68, 0.16, 0.14),
    "green": (0.22, 0.44, 0.18),
    "sky": (0.52, 0.66, 0.76),
    "skin": (0.78, 0.56, 0.44),
    "brass": (0.74, 0.60, 0.32),
}


def _plaster(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    tone = 1 + 0.10 * fractal_noise(shape, texel_m, rng, 1.2, 0.008, 0.75)
    return color * tone[..., None]


def _wallpaper(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """Stripes with a staggered medallion, on plaster that is not quite even."""
    x, y = grid_m(shape, texel_m)
    pitch_x, pitch_y = 0.30, 0.36
    column = np.floor(x / pitch_x)
    stripe = np.where(np.abs(x / pitch_x - column - 0.5) > 0.42, 0.35, 0.0) + 0 * y
    px = (x / pitch_x - column - 0.5) * pitch_x
    py = ((y / pitch_y + 0.5 * (column % 2)) % 1.0 - 0.5) * pitch_y
    r, a = np.hypot(px, py), np.arctan2(py, px)
    petals = 0.075 + 0.035 * np.cos(6 * a)
    flower = np.clip((petals - r) / 0.006, 0, 1) * (0.55 + 0.45 * np.cos(r * 190))
    leaf = np.clip(1 - np.abs(px - 0.05 * np.sin(py * 17)) / 0.008, 0, 1) * (r > 0.10)
    image = mix(color, color * 0.62, stripe + 0.3 * leaf)
    image = mix(image, np.clip(color * 0.45 + 0.05, 0, 1), 0.85 * flower)
    tone = 1 + 0.09 * fractal_noise(shape, texel_m, rng, 1.0, 0.008, 0.75)
    return image * tone[..., None]


def _brick(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    x, y = grid_m(shape, texel_m)
    row = np.floor(y / 0.075).astype(int)
    shifted = x / 0.23 + 0.5 * (row % 2)
    column = np.floor(shifted).astype(int)
    tint = rng.uniform(-1, 1, (int(row.max()) + 1, int(column.max()) + 2)).astype(np.float32)
    edge = np.minimum(
        np.minimum(shifted - column, 1 - (shifted - column)) * 0.23,
        np.minimum(y / 0.075 - row, 1 - (y / 0.075 - row)) * 0.075,
    )
    edge = edge + 0.003 * fractal_noise(shape, texel_m, rng, 0.05)
    brick = color * (1 + 0.28 * tint[row, column])[..., None]
    brick *= (1 + 0.16 * fractal_noise(shape, texel_m, rng, 0.12, 0.006, 0.8))[..., None]
    mortar = (
        np.array([0.66, 0.63, 0.58])
        * (1 + 0.10 * fractal_noise(shape, texel_m, rng, 0.1))[..., None]
    )
    return mix(mortar, brick, (edge - 0.006) / 0.004)


def _planks(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """Floor boards across, staggered, each with its own tone and grain."""
    x, y = grid_m(shape, texel_m)
    row = np.floor(y / 0.14).astype(int)
    offsets = rng.uniform(0, 1, int(row.max()) + 1).astype(np.float32)
    shifted = x / 1.1 + offsets[row]
    column = np.floor(shifted).astype(int)
    tint = rng.uniform(-1, 1, (int(row.max()) + 1, int(column.max()) + 1)).astype(np.float32)
    gap_x = np.minimum(shifted - column, 1 - (shifted - column)) * 1.1
    gap_y = np.minimum(y / 0.14 - row, 1 - (y / 0.14 - row)) * 0.14
    grain = fractal_noise(shape, texel_m, rng, 0.08, 0.005, 0.85, stretch=14)
    image = color * (1 + 0.22 * tint[row, column] + 0.22 * grain)[..., None]
    image *= (1 + 0.07 * fractal_noise(shape, texel_m, rng, 0.5, 0.01))[..., None]
    return mix(image * 0.35, image, (np.minimum(gap_x, gap_y) - 0.0015) / 0.003)


def _wood(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    if shape[0] > shape[1]:  # grain along the longer side
        return _wood((shape[1], shape[0]), texel_m, rng, color).swapaxes(0, 1)
    bend = fractal_noise(shape, texel_m, rng, 0.5, 0.05, 0.5, stretch=3)
    _, y = grid_m(shape, texel_m)
    rings = np.sin((y + 0.05 * bend) * 210 + 5 * bend)
    grain = fractal_noise(shape, texel_m, rng, 0.06, 0.004, 0.85, stretch=12)
    return color * (1 + 0.10 * rings + 0.24 * grain)[..., None]


def _fabric(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """A coarse weave with woven checks and uneven wear."""
    x, y = grid_m(shape, texel_m)
    checks = 0.5 * (np.sin(x * 42) > 0.55) + 0.5 * (np.sin(y * 42) > 0.55)
    weave = 0.05 * np.sin(x * 430) * np.sin(y * 430)
    wear = 0.16 * fractal_noise(shape, texel_m, rng, 0.3, 0.006, 0.8)
    return (
        mix(color, np.clip(color * 1.5 + 0.08, 0, 1), 0.5 * checks) * (1 + weave + wear)[..., None]
    )


def _carpet(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """An oriental rug: borders, a field of diamonds, a medallion, pile."""
    x, y = grid_m(shape, texel_m)
    w, h = shape[1] * texel_m, shape[0] * texel_m
    edge = np.minimum(np.minimum(x, w - x), np.minimum(y, h - y))
    dx, dy = x - w / 2, y - h / 2
    diamonds = np.sin((dx + dy) * 26) * np.sin((dx - dy) * 26)
    r = np.hypot(dx / w, dy / h) + 0.02 * np.cos(8 * np.arctan2(dy / h, dx / w))
    cream, ink = np.array([0.82, 0.74, 0.56]), np.array([0.10, 0.13, 0.22])
    image = mix(color, ink, (diamonds > 0.45) * 0.9)
    image = mix(image, cream, (np.abs(diamonds + 0.3) < 0.09) * 0.8)
    image = mix(image, ink, r < 0.27)
    image = mix(image, color, (r < 0.25) * (0.6 + 0.4 * np.cos(r * 130)))
    image = mix(image, cream, np.abs(r - 0.26) < 0.008)
    image = mix(image, ink, edge < 0.20)
    beads = np.sin(x * 55) * np.sin(y * 55)
    image = mix(image, color, (np.abs(edge - 0.10) < 0.055) * (beads > 0.1))
    image = mix(image, cream, (np.abs(edge - 0.18) < 0.012) | (np.abs(edge - 0.03) < 0.010))
    return image * (1 + 0.20 * fractal_noise(shape, texel_m, rng, 0.2, 0.006, 0.9))[..., None]


def _cardboard(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    x, y = grid_m(shape, texel_m)
    w, h = shape[1] * texel_m, shape[0] * texel_m
    base = (
        np.array([0.64, 0.48, 0.31])
        * (1 + 0.09 * fractal_noise(shape, texel_m, rng, 0.2, 0.005, 0.8) + 0.03 * np.sin(x * 900))[
            ..., None
        ]
    )
    base = mix(base, np.array([0.80, 0.70, 0.50]), (np.abs(y - h / 2) < 0.025) * 0.7)
    inside = (np.abs(x - 0.68 * w) < 0.16 * w) & (np.abs(y - 0.76 * h) < 0.12 * h)
    label = mix(
        np.array([0.9, 0.9, 0.88]), color, 0.8 * (np.sin(y * 300) > 0.1) * (np.sin(x * 150) > -0.5)
    )
    return np.where(inside[..., None], label, base)


def _stone(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    n = fractal_noise(shape, texel_m, rng, 0.3, 0.004, 0.75)
    veins = np.exp(-np.abs(fractal_noise(shape, texel_m, rng, 0.25, 0.01, 0.6)) * 14)
    return mix(color * (1 + 0.22 * n)[..., None], np.clip(color * 0.4, 0, 1), 0.6 * veins)


def _glazed(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """Painted pottery: bands, zigzags and speckles; meets itself around the back."""
    h, w = shape
    a = np.linspace(0, 2 * np.pi, w, dtype=np.float32)[None, :]
    v = np.linspace(0, 1, h, dtype=np.float32)[:, None]
    zigzag = np.abs((v * 6 + 0.25 * np.sin(12 * a)) % 1.0 - 0.5) < 0.13
    bands = (np.abs(v - 0.3) < 0.12) | (np.abs(v - 0.75) < 0.10)
    image = mix(color, np.array([0.90, 0.86, 0.76]), bands * 0.9 + 0 * a)
    image = mix(image, color * 0.3, zigzag * 0.8)
    return image * (1 + 0.14 * fractal_noise(shape, texel_m, rng, 0.08, 0.004, 0.9))[..., None]


def _leaves(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    n = fractal_noise(shape, texel_m, rng, 0.07, 0.006, 0.85)
    blades = np.sin(18 * value_noise(shape, (0.05 / texel_m, 0.05 / texel_m), rng))
    return color * (1 + 0.5 * n + 0.3 * blades)[..., None]


def _metal(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    brushed = fractal_noise(shape, texel_m, rng, 0.05, 0.004, 0.9, stretch=10)
    return color * (1 + 0.20 * brushed)[..., None]


def _panels(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """A door or cabinet front: raised panels with bevels on painted wood."""
    h, w = shape
    image = _wood(shape, texel_m, rng, color)
    rows, columns = max(1, round(h * texel_m / 0.75)), max(1, round(w * texel_m / 0.45))
    x, y = grid_m(shape, texel_m)
    px = (x / (w * texel_m) * columns) % 1.0 * (w * texel_m / columns)
    py = (y / (h * texel_m) * rows) % 1.0 * (h * texel_m / rows)
    edge = np.minimum(
        np.minimum(px, w * texel_m / columns - px), np.minimum(py, h * texel_m / rows - py)
    )
    bevel = np.clip(1 - np.abs(edge - 0.055) / 0.012, 0, 1)
    seam = np.clip(1 - edge / 0.005, 0, 1)
    return image * (1 - 0.45 * bevel - 0.6 * seam)[..., None]


_MATERIALS: dict[str, Callable[[Shape, float, Rng, np.ndarray], np.ndarray]] = {
    "plaster": _plaster,
    "wallpaper": _wallpaper,
    "brick": _brick,
    "planks": _planks,
    "tiles": tiles,
    "parquet": parquet,
    "stripes": stripes,
    "keys": keys,
    "paint": paint,
    "lino": lino,
    "glow": glow,
    "wood": _wood,
    "fabric": _fabric,
    "carpet": _carpet,
    "cardboard": _cardboard,
    "stone": _stone,
    "glazed": _glazed,
    "leaves": _leaves,
    "metal": _metal,
    "panels": _panels,
    "painting": painting,
    "poster": poster,
    "book": book_spine,
    "screen": screen,
    "window": window,
}


def blurred(image: np.ndarray, sigma_texels: float) -> np.ndarray:
    """The image without detail finer than the camera can see close up."""
    return cv2.GaussianBlur(image, (0, 0), sigma_texels)
