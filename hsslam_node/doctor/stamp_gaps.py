"""Frames that are missing."""

import numpy as np

from hsslam_node.doctor.finding import Finding

_LONG_GAP_S = 1.0
_FAULT_MISSING = 0.2
_NOTE_MISSING = 0.02
_NAME, _EXPECTED = "stamp gaps", "less than 2 % of the frames missing, no gap above 1 s"


def check_stamp_gaps(intervals_ns: np.ndarray) -> Finding:
    """Share of frames, %, that the intervals [N] int64 ns say were dropped."""
    forward = intervals_ns[intervals_ns > 0]
    if len(forward) == 0:
        return Finding(_NAME, "note", None, "%", "no two stamps that follow each other", _EXPECTED)
    period_ns = float(np.median(forward))
    periods = np.round(forward / period_ns)
    missing = float(np.maximum(periods - 1, 0).sum())
    share = missing / (missing + len(forward))
    longest_s = float(forward.max()) / 1e9
    seen = f"{100 * share:.1f} % of the frames are missing; the longest gap is {longest_s:.3g} s"
    advice = (
        "the recorder drops frames: write to a faster disk, record smaller images, or give the camera "
        "a USB port of its own; after a long gap the camera has to be found again"
    )
    if share > _FAULT_MISSING or (longest_s > _LONG_GAP_S and longest_s > 5e-9 * period_ns):
        return Finding(_NAME, "fault", 100 * share, "%", seen, _EXPECTED, advice)
    if share > _NOTE_MISSING:
        return Finding(_NAME, "note", 100 * share, "%", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", 100 * share, "%", seen, _EXPECTED)
