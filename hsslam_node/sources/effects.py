"""Sources that alter the frames of another: size, exposure, cover, noise and mask of the depth, stamps."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from scipy.special import ndtri

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.kernels.compiled import njit
from hsslam_node.sources.files.image_files import BadImageError, read_mask
from hsslam_node.sources.reports import reports_of
from hsslam_node.sources.source import (
    BadFrame,
    IsLate,
    LateFrame,
    ReadsInTime,
    Source,
    frames_in_time,
)


class ChangedSource(ReadsInTime):
    """The frames of another source, each put through `changed`; what cannot be read stays a `BadFrame`.

    A frame of another camera than the source's, as a log may have, becomes one.
    `suffix` is added to the name of the other source.
    """

    def __init__(self, source: Source, suffix: str) -> None:
        self._source = source
        self.name = f"{source.name} {suffix}"
        self.camera = source.camera
        self.rate_hz = source.rate_hz
        self.frame_count = source.frame_count
        self.depth_units_per_m = source.depth_units_per_m
        self.reports = reports_of(source)

    def frames_in_time(self, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
        """The frames of the other source, changed; late ones are left out if it can do that."""
        for frame in frames_in_time(self._source, first, is_late):
            if isinstance(frame, BadFrame):
                yield frame
            elif differs := frame.camera.differs_in(self._source.camera):
                name, here, expected = differs
                reason = f"{name} {here}: expected {expected} as in the first frame"
                yield BadFrame(frame.index, frame.stamp_ns, reason)
            else:
                yield self.changed(frame)

    @abstractmethod
    def changed(self, frame: Frame) -> Frame:
        """This frame as the source delivers it."""


class Restamped(ChangedSource):
    """A source whose frames come more than once, stamped as by a camera that never stopped: n / rate."""

    def __init__(self, source: Source) -> None:
        super().__init__(source, "played again")

    def frames_in_time(self, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
        """As of any `ChangedSource`; frames are late by their new stamps."""

        def is_late_now(index: int, stamp_ns: int) -> bool:
            return is_late(index, running_stamp_ns(index, self.rate_hz))

        for item in super().frames_in_time(first, is_late_now):
            if isinstance(item, LateFrame):
                item = replace(item, stamp_ns=running_stamp_ns(item.index, self.rate_hz))
            yield item

    def changed(self, frame: Frame) -> Frame:
        """The frame at its time."""
        return replace(frame, stamp_ns=running_stamp_ns(frame.index, self.rate_hz))


def running_stamp_ns(index: int, rate_hz: float) -> int:
    """Stamp of frame `index` of a source that is played again, ns."""
    return round(index * 1e9 / rate_hz)


_ONE_SURFACE = 0.05  # depths of one surface differ by less than this share


class Downscaled(ChangedSource):
    """A source whose images are `factor` times smaller along each side.

    Colour is averaged over the area of a pixel. Depth is not, since a mean across an edge lies on
    neither surface: a pixel has the measurement at its centre. If the factor is even, the centre lies
    between four measurements: of one surface their mean inverse depth, which is linear on a plane, else
    that of the upper left one.

    Raises:
        UserError: the size of the images is not a multiple of the factor.
    """

    def __init__(self, source: Source, factor: int) -> None:
        camera = source.camera
        if camera.width_px % factor or camera.height_px % factor:
            raise UserError(
                f"--downscale {factor}: images are {camera.width_px}x{camera.height_px}: "
                "expected a factor that divides both sides"
            )
        super().__init__(source, f"at 1/{factor} size")
        self._factor = factor
        self.camera = camera.scaled(1.0 / factor)

    def changed(self, frame: Frame) -> Frame:
        """The frame, smaller."""
        size = (self.camera.width_px, self.camera.height_px)
        color = cv2.resize(frame.color, size, interpolation=cv2.INTER_AREA)
        depth_raw = _depth_at_centers(frame.depth_raw, self._factor)
        return replace(
            frame, camera=self.camera, color=np.asarray(color, np.uint8), depth_raw=depth_raw
        )


def _depth_at_centers(depth_raw: np.ndarray, factor: int) -> np.ndarray:
    """Depth [h, w] uint16 at the centres of blocks of factor x factor pixels of [H, W]."""
    first = (factor - 1) // 2
    nearest = np.ascontiguousarray(depth_raw[first::factor, first::factor])
    if factor % 2:
        return nearest
    offsets = (first, first + 1)
    four = np.stack([depth_raw[v::factor, u::factor] for v in offsets for u in offsets])
    low, high = four.min(axis=0), four.max(axis=0)
    is_one_surface = (low > 0) & (high - low < _ONE_SURFACE * high)
    inverse = (1.0 / np.maximum(four, 1, dtype=np.float32)).sum(axis=0)  # [h, w]
    return np.where(is_one_surface, np.rint(4.0 / inverse).astype(np.uint16), nearest)


class Masked(ChangedSource):
    """A source without depth in the pixels that are black in a mask, as of the robot itself in its view.

    `mask`: an image file of the size of the frames, which have no lens distortion; of a colour image
    the brightest channel counts.

    Raises:
        UserError: the mask cannot be read, or has another size.
    """

    def __init__(self, source: Source, mask: str) -> None:
        super().__init__(source, "with a mask")
        try:
            self._is_hidden = read_mask(Path(mask), source.camera)  # [H, W]
        except BadImageError as error:
            raise UserError(f"--mask {error}") from None

    def changed(self, frame: Frame) -> Frame:
        """The frame, without depth where it is hidden."""
        depth_raw = np.where(self._is_hidden, np.uint16(0), frame.depth_raw)
        return replace(frame, depth_raw=depth_raw)


class Covered(ChangedSource):
    """A source whose lens is covered for some frames: they are black and without depth; odometry stays."""

    def __init__(self, source: Source, first: int, count: int) -> None:
        super().__init__(source, "with a covered lens")
        self._covered = range(first, first + count)

    def changed(self, frame: Frame) -> Frame:
        """The frame, without anything to be seen if it is one of these."""
        if frame.index not in self._covered:
            return frame
        color, depth_raw = np.zeros_like(frame.color), np.zeros_like(frame.depth_raw)
        return replace(frame, color=color, depth_raw=depth_raw)


_JUMP_EVERY = 120  # frames
_JUMP = (1.22, 1.30)
_DRIFT, _DRIFT_FRAMES = (0.10, 0.06), (230.0, 97.0)
_BIAS_GREY, _BIAS_FRAMES = 6.0, 310.0


class ChangingExposure(ChangedSource):
    """A source whose brightness changes from frame to frame; depth is not touched.

    Grey values go through gain x value + bias and are clipped to [0, 255]. The gain drifts smoothly by up
    to 16 %, and every four seconds or so it jumps by 20 to 30 %, up or down, and at the next
    jump back; the bias drifts by 6 grey levels. All depends on seed and frame index only.
    """

    def __init__(self, source: Source, seed: int) -> None:
        super().__init__(source, "with changing exposure")
        self._seed = seed

    def changed(self, frame: Frame) -> Frame:
        """The frame, brighter or darker."""
        gain, bias = exposure(self._seed, frame.index)
        grey = np.clip(gain * np.arange(256) + bias + 0.5, 0, 255).astype(np.uint8)
        return replace(frame, color=np.asarray(cv2.LUT(frame.color, grey), np.uint8))


def exposure(seed: int, index: int) -> tuple[float, float]:
    """Gain and bias (grey levels) of frame `index`."""
    phases = np.random.default_rng((seed, 5)).uniform(0, 2 * np.pi, 3)
    drift = sum(
        a * np.sin(2 * np.pi * index / frames + phase)
        for a, frames, phase in zip(_DRIFT, _DRIFT_FRAMES, phases, strict=False)
    )
    bias = _BIAS_GREY * np.sin(2 * np.pi * index / _BIAS_FRAMES + phases[2])
    return float(_level(seed, index) * np.exp(drift)), float(bias)


def _level(seed: int, index: int) -> float:
    """Gain without drift: one jump in every slot of frames, away from 1 and back in turn."""
    slot, within = divmod(index, _JUMP_EVERY)
    rng = np.random.default_rng((seed, 6, slot // 2))
    factor = rng.uniform(*_JUMP) ** rng.choice([-1, 1])
    away, back = rng.integers(_JUMP_EVERY // 4, 3 * _JUMP_EVERY // 4, 2)
    is_away = within >= away if slot % 2 == 0 else within < back
    return float(factor) if is_away else 1.0


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
