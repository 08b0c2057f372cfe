"""Images whose brightness drifts and jumps."""

from dataclasses import replace

import cv2
import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.sources.effects.changed_source import ChangedSource
from hsslam_node.sources.source import Source

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
