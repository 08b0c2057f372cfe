"""Whether stamps go forward."""

import numpy as np

from hsslam_node.doctor.finding import Finding

_EXPECTED = "every stamp later than the one before"


def check_stamp_order(intervals_ns: np.ndarray, of: str) -> Finding:
    """Intervals [N] int64 ns between images `of` one kind in the order in which they are recorded."""
    name = f"stamp order, {of}"
    back, same = int((intervals_ns < 0).sum()), int((intervals_ns == 0).sum())
    if back + same == 0:
        return Finding(name, "ok", 0.0, "stamps", "every stamp is later than the last", _EXPECTED)
    seen = f"{back} of {len(intervals_ns) + 1} stamps go back in time, {same} are there twice"
    advice = (
        "stamp images with the time of their exposure, from one clock that never steps, and write them "
        "in that order; twice the same stamp is mostly one image written twice"
    )
    return Finding(name, "fault", float(back + same), "stamps", seen, _EXPECTED, advice)
