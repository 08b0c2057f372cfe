"""How many frames a second the stamps say."""

import numpy as np

from hsslam_node.doctor.finding import Finding

_FAULT_BELOW_HZ = 5.0
_NOTE_BELOW_HZ = 15.0
_FAULT_ABOVE_HZ = 250.0  # stamps in ms or us that were read as seconds, or the other way round
_NAME, _EXPECTED = "rate", "15 to 120 Hz"


def check_rate(intervals_ns: np.ndarray) -> Finding:
    """Median rate, Hz, from the intervals [N] int64 ns between consecutive frames."""
    forward = intervals_ns[intervals_ns > 0]
    if len(forward) == 0:
        return Finding(_NAME, "note", None, "Hz", "no two stamps that follow each other", _EXPECTED)
    rate_hz = 1e9 / float(np.median(forward))
    seen = f"{rate_hz:.4g} frames a second"
    if rate_hz < _FAULT_BELOW_HZ or rate_hz > _FAULT_ABOVE_HZ:
        advice = (
            "check that the stamps are in seconds; if they are, record faster: between two frames "
            "the view moves too far to be followed"
            if rate_hz < _FAULT_BELOW_HZ
            else "check that the stamps are in seconds, and that no stamp is written twice"
        )
        return Finding(_NAME, "fault", rate_hz, "Hz", seen, _EXPECTED, advice)
    if rate_hz < _NOTE_BELOW_HZ:
        advice = "move slowly, or record faster"
        return Finding(_NAME, "note", rate_hz, "Hz", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", rate_hz, "Hz", seen, _EXPECTED)
