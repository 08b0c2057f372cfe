"""Whether depth lies on the image."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.doctor.edge_shift import REACH_PX, edge_shifts
from hsslam_node.doctor.finding import Finding

_FAULT_PX, _NOTE_PX = 4.0, 2.0  # of an image 640 pixels wide
_NAME = "registration"


def check_registration(images: Sequence[tuple[np.ndarray, np.ndarray]]) -> Finding:
    """How far colour lies from depth, pixels; pairs of colour [H, W, 3] uint8 and depth [H, W] m (0 = none).

    Shifts of up to 24 pixels (of 640) are found; a depth image of another focal length is not.
    """
    factor = images[0][0].shape[1] / 640 if images else 1.0
    expected = f"edges of depth and colour within {_NOTE_PX * factor:.1f} pixels"
    shifts = edge_shifts(images)
    clear = [s for s in shifts or () if s.clear]
    if shifts is None or not clear:
        seen = "too few edges that both images have to tell whether depth lies on colour"
        return Finding(_NAME, "note", None, "px", seen, expected, "look at it in the viewer")
    words = [
        f"{abs(s.shift_px):.1f} px {after if s.shift_px > 0 else before}"
        if s.clear
        else f"unclear {where}"
        for s, before, after, where in (
            (shifts[0], "left of", "right of", "in x"),
            (shifts[1], "above", "below", "in y"),
        )
    ]
    off = max(abs(s.shift_px) for s in clear)
    seen = f"edges of colour lie {words[0]} and {words[1]} those of depth"
    advice = (
        "register depth to colour with the sensor's own driver (depth_registration, align_to_color), or "
        "shift one of the images by as much; nothing must crop or flip only one of them"
    )
    if off >= (REACH_PX - 1) * factor:
        seen += " or further"
    if off >= _FAULT_PX * factor:
        return Finding(_NAME, "fault", off, "px", seen, expected, advice)
    if off >= _NOTE_PX * factor:
        return Finding(_NAME, "note", off, "px", seen, expected, advice)
    return Finding(_NAME, "ok", off, "px", seen, expected)
