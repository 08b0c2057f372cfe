"""How much of the image has depth."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.doctor.finding import Finding

_FAULT_BELOW, _NOTE_BELOW = 0.20, 0.50
_EMPTY_BELOW = 0.02  # such a frame cannot be tracked
_FAULT_EMPTY, _NOTE_EMPTY = 0.10, 0.0
_NAME, _EXPECTED = "depth coverage", "above 50 % of the pixels, no frame without depth"


def check_coverage(depths_raw: Sequence[np.ndarray]) -> Finding:
    """Median share of pixels with depth, %; depths [H, W] uint16, 0 = none."""
    if not depths_raw:
        return Finding(_NAME, "note", None, "%", "no frame could be read", _EXPECTED)
    shares = np.array([np.count_nonzero(depth) / depth.size for depth in depths_raw])
    median, empty = float(np.median(shares)), float((shares < _EMPTY_BELOW).mean())
    seen = (
        f"{100 * median:.0f} % of the pixels have depth (least {100 * shares.min():.0f} %); "
        f"{100 * empty:.0f} % of the frames have none"
    )
    advice = (
        "keep 0.5 to 4 m from surfaces; sunlight, glass, mirrors and black things give no depth; see "
        "that the emitter is on, and that nothing covers it"
    )
    if median < _FAULT_BELOW or empty > _FAULT_EMPTY:
        return Finding(_NAME, "fault", 100 * median, "%", seen, _EXPECTED, advice)
    if median < _NOTE_BELOW or empty > _NOTE_EMPTY:
        return Finding(_NAME, "note", 100 * median, "%", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", 100 * median, "%", seen, _EXPECTED)
