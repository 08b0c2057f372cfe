"""How far the view moves from one frame to the next."""

from collections.abc import Sequence

import cv2
import numpy as np

from hsslam_node.doctor.finding import Finding

_WIDTH_PX = 320
_FAULT_ABOVE, _NOTE_ABOVE = 0.10, 0.04  # of the width
_NAME, _EXPECTED = "motion of the view", "below 4 % of the width a frame"


def check_view_motion(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> Finding:
    """95th percentile of the median optical flow, % of the width; pairs of colour [H, W, 3] uint8 RGB."""
    if not pairs:
        return Finding(_NAME, "note", None, "%", "no two frames that follow each other", _EXPECTED)
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    moved = []
    for first, second in pairs:
        a, b = _small(first), _small(second)
        u = np.zeros((*a.shape, 2), np.float32)
        u = flow.calc(a, b, u)
        moved.append(float(np.median(np.linalg.norm(u, axis=2))) / a.shape[1])
    median, fast = float(np.median(moved)), float(np.percentile(moved, 95))
    seen = f"the view moves by {100 * median:.2f} % of the width a frame, {100 * fast:.2f} % at its fastest"
    advice = "move and above all turn more slowly, or record at a higher rate"
    if fast > _FAULT_ABOVE:
        return Finding(_NAME, "fault", 100 * fast, "%", seen, _EXPECTED, advice)
    if fast > _NOTE_ABOVE:
        return Finding(_NAME, "note", 100 * fast, "%", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", 100 * fast, "%", seen, _EXPECTED)


def _small(color: np.ndarray) -> np.ndarray:
    height = max(round(color.shape[0] * _WIDTH_PX / color.shape[1]), 32)
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    return cv2.resize(grey, (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
