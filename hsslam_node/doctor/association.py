"""Whether every colour image has its depth image."""

import numpy as np

from hsslam_node.doctor.finding import Finding

_FAULT_ALONE = 0.10
_NOTE_ALONE = 0.02
_NOTE_APART_MS = (
    10.0  # as far as two cameras of 30 Hz that are not triggered together get: up to 17
)
_NAME = "association"
_EXPECTED = "a depth image within 20 ms of every colour image, 10 ms at the median"


def check_association(color_ns: np.ndarray, depth_ns: np.ndarray, max_dt_ns: int) -> Finding:
    """Share of colour images, %, without a depth image within `max_dt_ns`; stamps [N], [M] int64 ns."""
    to_depth = _to_nearest_ns(color_ns, depth_ns)
    alone = float((np.abs(to_depth) > max_dt_ns).mean())
    offset_ms = float(np.median(to_depth)) / 1e6
    apart_ms = float(np.median(np.abs(to_depth))) / 1e6
    seen = (
        f"{100 * alone:.1f} % of the colour images have no depth within {max_dt_ns / 1e6:.0f} ms; "
        f"depth is {apart_ms:.1f} ms away at the median"
    )
    if alone > _FAULT_ALONE:
        advice = "record colour and depth together; images without a partner are left out of a run"
        if abs(offset_ms) > max_dt_ns / 2e6:
            advice = (
                f"depth stamps lie {offset_ms:+.1f} ms from colour throughout: if both share a clock, "
                "correct that offset in one of the lists"
            )
        return Finding(_NAME, "fault", 100 * alone, "%", seen, _EXPECTED, advice)
    if alone > _NOTE_ALONE or apart_ms > _NOTE_APART_MS:
        advice = "let the sensor trigger colour and depth together where it can; move slowly if not"
        return Finding(_NAME, "note", 100 * alone, "%", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", 100 * alone, "%", seen, _EXPECTED)


def _to_nearest_ns(a_ns: np.ndarray, b_ns: np.ndarray) -> np.ndarray:
    """From each of a [N] to the nearest of b, [N] int64 ns."""
    b_ns = np.sort(b_ns)
    after = np.clip(np.searchsorted(b_ns, a_ns), 1, max(len(b_ns) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(b_ns) - 1)
    nearer = np.abs(b_ns[after] - a_ns) < np.abs(b_ns[before] - a_ns)
    return np.where(nearer, b_ns[after], b_ns[before]) - a_ns
