"""Whether stamps are as regular as the camera's clock."""

import numpy as np

from hsslam_node.doctor.finding import Finding

_FAULT_ABOVE = 0.10  # of the period: 2.4 ms a stamp at 30 Hz
_NOTE_ABOVE = 0.05  # a Kinect whose driver stamps in steps of 4 ms has 0.06
_GAP = 1.5  # periods; an interval longer than that is a dropped frame
_LEAST_INTERVALS = 10
_EXPECTED = "below 10 % of the period"


def check_stamp_jitter(intervals_ns: np.ndarray, of: str) -> Finding:
    """Deviation of the intervals [N] int64 ns between images `of` one kind, ms.

    Dropped frames do not count: an interval of about n periods is compared with n periods.
    """
    name = f"stamp jitter, {of}"
    forward = intervals_ns[intervals_ns > 0].astype(np.float64)
    if len(forward) < _LEAST_INTERVALS:
        return Finding(name, "note", None, "ms", "too few stamps to tell", _EXPECTED)
    period_ns = float(np.median(forward))
    single = forward[forward < _GAP * period_ns]
    if len(single) > 1:
        period_ns = float(single.mean())
    off_ns = forward - np.maximum(np.round(forward / period_ns), 1) * period_ns
    jitter_ns = float(np.sqrt((off_ns**2).mean()))
    share = jitter_ns / period_ns
    jitter_ms = jitter_ns / 1e6
    seen = (
        f"intervals deviate by {jitter_ms:.2f} ms ({100 * share:.1f} % of the period of "
        f"{period_ns / 1e6:.1f} ms)"
    )
    advice = (
        "use the sensor's own stamps instead of the time of arrival; where there are none, frame n of "
        "a camera with a steady clock is at n / rate"
    )
    if share > _FAULT_ABOVE:
        return Finding(name, "fault", jitter_ms, "ms", seen, _EXPECTED, advice)
    if share > _NOTE_ABOVE:
        return Finding(name, "note", jitter_ms, "ms", seen, _EXPECTED, advice)
    return Finding(name, "ok", jitter_ms, "ms", seen, _EXPECTED)
