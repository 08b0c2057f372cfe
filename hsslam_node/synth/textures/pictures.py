"""Textures that show something: paintings, posters, book spines, a screen, a window."""

import cv2
import numpy as np

from hsslam_node.synth.textures.noise_pattern import fractal_noise, grid_m, mix, value_noise

Rng = np.random.Generator
Shape = tuple[int, int]


def painting(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """A landscape: sky, sun, ranges of hills, brush strokes; inside a mat."""
    h, w = shape
    u = np.linspace(0, 1, w, dtype=np.float32)[None, :]
    v = np.linspace(0, 1, h, dtype=np.float32)[:, None]
    sky, glow = rng.uniform(0.3, 0.7, 3), np.array([0.95, 0.75, 0.45])
    image = mix(sky, glow, v * 1.5 + 0 * u)
    sun = np.hypot((u - rng.uniform(0.2, 0.8)) * w / h, v - rng.uniform(0.2, 0.35))
    image = mix(image, np.array([0.98, 0.88, 0.6]), np.clip((0.11 - sun) / 0.01, 0, 1))
    for depth in range(5):
        ridge = 0.38 + 0.11 * depth + 0.09 * np.sin(u * rng.uniform(5, 14) + rng.uniform(0, 6))
        ridge = ridge + 0.03 * np.sin(u * rng.uniform(25, 50) + rng.uniform(0, 6))
        tint = mix(rng.uniform(0.1, 0.6, 3), color * 0.6, np.full(shape, 0.3 + 0.1 * depth))
        image = np.where((v > ridge)[..., None], tint * (1.1 - 0.12 * depth), image)
    strokes = fractal_noise(shape, texel_m, rng, 0.06, 0.004, 0.9, stretch=4)
    image = image * (1 + 0.28 * strokes)[..., None]
    x, y = grid_m(shape, texel_m)
    edge = np.minimum(np.minimum(x, w * texel_m - x), np.minimum(y, h * texel_m - y))
    image = mix(image, np.array([0.88, 0.86, 0.80]), edge < 0.05)
    return mix(image, np.array([0.30, 0.20, 0.12]), edge < 0.02)


def poster(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """An abstract print: overlapping discs and bars in flat colours."""
    h, w = shape
    image = np.full((h, w, 3), rng.uniform(0.55, 0.9, 3), np.float32)
    for _ in range(14):
        tint = tuple(float(c) for c in rng.uniform(0.08, 0.95, 3))
        x, y = int(rng.integers(0, w)), int(rng.integers(0, h))
        if rng.random() < 0.6:
            cv2.circle(
                image, (x, y), int(rng.uniform(0.05, 0.28) * min(h, w)), tint, -1, cv2.LINE_AA
            )
        else:
            size = (int(rng.uniform(0.05, 0.5) * w), int(rng.uniform(0.03, 0.2) * h))
            cv2.rectangle(image, (x, y), (x + size[0], y + size[1]), tint, -1)
    image *= (1 + 0.10 * fractal_noise(shape, texel_m, rng, 0.15, 0.004, 0.9))[..., None]
    cv2.rectangle(image, (0, 0), (w - 1, h - 1), (0.12, 0.12, 0.12), max(2, int(0.02 / texel_m)))
    return image


def book_spine(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """Bands across a spine and something like a title along it."""
    h, w = shape
    image = np.full((h, w, 3), color, np.float32)
    gold = np.array([0.85, 0.72, 0.40]) if rng.random() < 0.6 else rng.uniform(0.6, 0.95, 3)
    for place in rng.uniform(0.03, 0.97, 4):
        row = int(place * h)
        image[row : row + max(1, int(0.006 / texel_m))] = gold
    top, bottom = int(0.25 * h), int(0.7 * h)
    letters = rng.random((max(1, (bottom - top) * 3 // 8), 2)) < 0.6
    title = cv2.resize(letters.astype(np.float32), (max(1, w // 2), max(1, bottom - top)))
    image[top:bottom, w // 4 : w // 4 + title.shape[1]] = mix(color, gold, title)
    return image * (1 + 0.12 * fractal_noise(shape, texel_m, rng, 0.08, 0.003, 0.9))[..., None]


def screen(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """A display with two windows of text and a chart."""
    h, w = shape
    image = mix(
        np.array([0.08, 0.12, 0.22]),
        np.array([0.25, 0.16, 0.35]),
        0.5 + 0.5 * value_noise(shape, (h / 2, w / 2), rng),
    )
    for left, right, paper in ((0.05, 0.52, 0.10), (0.56, 0.95, 0.86)):
        x0, x1, y0, y1 = int(left * w), int(right * w), int(0.10 * h), int(0.90 * h)
        image[y0:y1, x0:x1] = paper
        line = max(3, (y1 - y0) // 22)
        for y in range(y0 + line, y1 - line, line):
            x = x0 + int(rng.integers(2, 8)) * (x1 - x0) // 40
            while x < x1 - 8:
                end = min(x + int(rng.uniform(0.04, 0.18) * (x1 - x0)), x1 - 4)
                if rng.random() < 0.75:
                    image[y : y + max(1, line // 2), x:end] = rng.uniform(0.2, 0.9, 3)
                x = end + max(2, (x1 - x0) // 50)
    image[: max(1, int(0.03 * h))] = (
        image[-max(1, int(0.05 * h)) :, :][: max(1, int(0.03 * h))] * 0.4
    )
    return image


def window(shape: Shape, texel_m: float, rng: Rng, color: np.ndarray) -> np.ndarray:
    """The view out of a window: clouds, a tree line, panes."""
    h, w = shape
    u = np.linspace(0, 1, w, dtype=np.float32)[None, :]
    v = np.linspace(0, 1, h, dtype=np.float32)[:, None]
    image = mix(np.array([0.45, 0.65, 0.92]), np.array([0.85, 0.92, 0.98]), v + 0 * u)
    clouds = fractal_noise(shape, texel_m, rng, 0.5, 0.01, 0.6, stretch=2)
    image = mix(image, np.array([0.98, 0.98, 0.97]), clouds * 1.2 - 0.1)
    trees = (
        0.72
        + 0.10 * value_noise((1, w), (1, w / 7), rng)
        + 0.04 * value_noise((1, w), (1, w / 30), rng)
    )
    foliage = fractal_noise(shape, texel_m, rng, 0.10, 0.006, 0.9)
    green = np.array([0.22, 0.40, 0.16]) * (1 + 0.6 * foliage)[..., None]
    image = np.where((v > trees)[..., None], green, image)
    panes = (np.abs(u - 0.5) < 0.012) | (np.abs(v - 0.42) < 0.014) | (np.abs(u - 0.5) > 0.475)
    return mix(image, np.array([0.90, 0.89, 0.86]), panes | (np.abs(v - 0.5) > 0.47))
