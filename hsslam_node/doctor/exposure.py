"""Whether images are exposed well, and alike."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.doctor.finding import Finding

_DARK, _BRIGHT = 8, 250
_FAULT_FLAT = 0.9  # black or white all over: the lens is covered, or there is no light
_NOTE_FLAT = 0.35
_DARK_MEAN = 40.0
_NOTE_JUMP = 0.10
_NAME, _EXPECTED = (
    "exposure",
    "below 35 % of the pixels black or white, brightness steady within 10 %",
)


def check_exposure(
    images: Sequence[np.ndarray], pairs: Sequence[tuple[np.ndarray, np.ndarray]]
) -> Finding:
    """Median share of pixels that are black or white, %; images [H, W, 3] uint8, and consecutive pairs."""
    if not images:
        return Finding(_NAME, "note", None, "%", "no frame could be read", _EXPECTED)
    greens = [image[::4, ::4, 1] for image in images]
    flat = float(np.median([np.mean((g < _DARK) | (g > _BRIGHT)) for g in greens]))
    mean = float(np.median([g.mean() for g in greens]))
    jumps = [
        abs(b[::4, ::4].mean() / max(a[::4, ::4].mean(), 1e-9) - 1) for a, b in pairs if a.any()
    ]
    jump = float(np.percentile(jumps, 95)) if jumps else 0.0
    seen = (
        f"{100 * flat:.0f} % of the pixels are black or white, mean grey level {mean:.0f} of 255; "
        f"brightness changes by {100 * jump:.1f} % a frame at most"
    )
    if flat > _FAULT_FLAT:
        advice = (
            "there is no picture: see that the lens is free, the light on, the exposure automatic"
        )
        return Finding(_NAME, "fault", 100 * flat, "%", seen, _EXPECTED, advice)
    if flat > _NOTE_FLAT or mean < _DARK_MEAN or jump > _NOTE_JUMP:
        advice = "more light, fixed exposure and white balance; avoid windows in the picture"
        return Finding(_NAME, "note", 100 * flat, "%", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", 100 * flat, "%", seen, _EXPECTED)
