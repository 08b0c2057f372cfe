"""Check of the noise of depth; alone because it takes whole frames, as the tracker does."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hsslam_node.depth_noise import (
    EXACT_NOISE,
    LEAST_INDEPENDENT,
    depth_noise,
    independent_pixels,
)
from hsslam_node.doctor.finding import Check, Finding
from hsslam_node.frame import Frame

_AT_M: Final = 2.0
_NOTE_ABOVE_MM: Final = 20.0
_LEAST_DEPTH: Final = 0.02  # share of the pixels
_NOISE = Check(
    "depth noise", "mm", f"standard deviation below {_NOTE_ABOVE_MM:g} mm at {_AT_M:g} m"
)


def check_depth_noise(frames: Sequence[Frame]) -> Finding:
    """Median standard deviation of the depth 2 m away, mm."""
    known = [f for f in frames if np.count_nonzero(f.depth_raw) > _LEAST_DEPTH * f.depth_raw.size]
    if not known:
        return _NOISE.note(None, "no frame has enough depth")
    noises = [depth_noise(frame) for frame in known]  # 1/m, of the inverse depth
    noise = float(np.median(noises))
    value_mm = 1e3 * noise * _AT_M**2
    if noise < EXACT_NOISE:
        return _NOISE.ok(value_mm, f"below {1e3 * EXACT_NOISE * _AT_M**2:.1f} mm at {_AT_M:g} m")
    pixels = float(np.median([independent_pixels(*of) for of in zip(known, noises, strict=True)]))
    is_averaged = pixels >= LEAST_INDEPENDENT
    seen = (
        f"standard deviation {value_mm:.1f} mm at {_AT_M:g} m; {pixels:.0f} of 25 neighbouring pixels are "
        f"independent: the tracker {'averages them' if is_averaged else 'does not average them'}"
    )
    if value_mm > _NOTE_ABOVE_MM:
        advice = "keep nearer to surfaces; check the emitter, and filters of the camera's driver"
        return _NOISE.note(value_mm, seen, advice)
    return _NOISE.ok(value_mm, seen)
