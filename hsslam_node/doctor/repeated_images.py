"""Images that come twice."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.doctor.finding import Finding

_FAULT_ABOVE = 0.30  # a Kinect that is read faster than it delivers has 0.1
_NAME, _EXPECTED = "repeated images", "no image twice"


def check_repeated_images(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> Finding:
    """Share of consecutive images, %, that are the same to the last bit; pairs of arrays of one shape."""
    if not pairs:
        return Finding(_NAME, "note", None, "%", "no two frames that follow each other", _EXPECTED)
    share = float(np.mean([np.array_equal(a, b) for a, b in pairs]))
    seen = f"{100 * share:.0f} % of the images are copies of the one before"
    if share > _FAULT_ABOVE:
        advice = "the camera or recorder repeats frames to keep its rate: record at the rate it has"
        return Finding(_NAME, "fault", 100 * share, "%", seen, _EXPECTED, advice)
    if share > 0:
        return Finding(_NAME, "note", 100 * share, "%", seen, _EXPECTED)
    return Finding(_NAME, "ok", 0.0, "%", seen, _EXPECTED)
