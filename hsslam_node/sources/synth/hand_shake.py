"""The unsteadiness of a hand."""

import numpy as np


def hand_shake(length: int, rng: np.random.Generator) -> np.ndarray:
    """Six smooth, periodic channels [length, 6] of about unit size: sines of 0.3 to 2.3 Hz."""
    t = np.arange(length)[:, None] / length
    total = np.zeros((length, 6))
    for period_frames in (90, 55, 34, 21, 13):
        cycles = max(1, round(length / period_frames))
        amplitude = (period_frames / 90) ** 1.1
        total += amplitude * np.sin(2 * np.pi * (cycles * t + rng.uniform(0, 1, (1, 6))))
    return total / 1.5
