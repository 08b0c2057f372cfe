"""Depth with the noise of a structured-light sensor."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.special import ndtri

from hsslam_node.frame import Frame
from hsslam_node.kernels.compiled import njit
from hsslam_node.sources.effects.changed_source import ChangedSource
from hsslam_node.sources.source import Source

_JITTER_PX = 0.5
_FOCAL_BASELINE = 580.0 * 0.075  # px m, disparity = this / depth
_SIGMA_DISPARITY_PX = 1.425e-3 * _FOCAL_BASELINE  # sigma_z = 1.425e-3 z^2 m
_STEPS_PER_PX = 8.0
_MAX_DEPTH_M = 6.0
_TABLE_BITS = 12


class KinectNoise(ChangedSource):
    """A source whose depth went through a structured-light sensor.

    Each pixel looks up the depth of a neighbour (Gaussian, 0.5 px), its disparity for a 580 px x
    7.5 cm baseline gets Gaussian noise worth sigma_z = 1.425e-3 z^2 m (Khoshelham and Elberink
    2012) and is rounded to 1/8 px; nothing beyond 6 m. The noise of a frame depends on seed and
    frame index only.
    """

    def __init__(self, source: Source, seed: int) -> None:
        super().__init__(source, "with kinect noise")
        self._seed = seed

    def changed(self, frame: Frame) -> Frame:
        """The frame, its depth made noisy."""
        units_per_m = frame.depth_units_per_m
        depth_raw = add_kinect_noise(frame.depth_raw, units_per_m, self._seed, frame.index)
        return replace(frame, depth_raw=depth_raw)


def add_kinect_noise(
    depth_raw: np.ndarray, units_per_m: float, seed: int, index: int
) -> np.ndarray:
    """Noisy copy of a depth image [H, W] uint16 (0 = no measurement) for frame `index`."""
    key = np.random.SeedSequence((seed, index)).generate_state(1, np.uint64)[0]
    out = np.empty_like(depth_raw)
    _apply(np.ascontiguousarray(depth_raw), units_per_m, key, _normal_quantiles(), out)
    return out


@cache
def _normal_quantiles() -> np.ndarray:
    """Midpoint quantiles of the standard normal, [4096] float32: a hash of 12 bits picks one."""
    n = 1 << _TABLE_BITS
    quantiles = ndtri((np.arange(n) + 0.5) / n)
    return (quantiles / quantiles.std()).astype(np.float32)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _apply(depth_raw, units_per_m, key, normal, out):
    height, width = depth_raw.shape
    mask = np.uint64(len(normal) - 1)
    numerator = np.float32(_FOCAL_BASELINE * units_per_m)
    max_raw = np.float32(min(_MAX_DEPTH_M * units_per_m, 65535.0))
    for v in range(height):
        for u in range(width):
            # splitmix64 of the pixel's number: three draws of 12 bits from one hash
            h = key + np.uint64(v * width + u) * np.uint64(0x9E3779B97F4A7C15)
            h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            h = h ^ (h >> np.uint64(31))
            du = normal[h & mask] * np.float32(_JITTER_PX)
            dv = normal[(h >> np.uint64(16)) & mask] * np.float32(_JITTER_PX)
            noise = normal[(h >> np.uint64(32)) & mask] * np.float32(_SIGMA_DISPARITY_PX)
            x = min(max(int(np.floor(u + du + np.float32(0.5))), 0), width - 1)
            y = min(max(int(np.floor(v + dv + np.float32(0.5))), 0), height - 1)
            raw = np.float32(depth_raw[y, x])
            value = np.uint16(0)
            if raw > 0 and raw <= max_raw:
                disparity = numerator / raw + noise
                steps = np.floor(disparity * np.float32(_STEPS_PER_PX) + np.float32(0.5))
                if steps > 0:
                    noisy = numerator * np.float32(_STEPS_PER_PX) / steps
                    if noisy <= max_raw:
                        value = np.uint16(noisy + np.float32(0.5))
            out[v, u] = value
