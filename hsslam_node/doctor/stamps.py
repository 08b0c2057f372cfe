"""Checks of stamps: their rate, order, gaps and jitter, and whether colour has its depth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hsslam_node.doctor.finding import Check, Finding
from hsslam_node.sources.registry import SOURCES
from hsslam_node.sources.source_row import SourceRow, find_row, imported, source_name
from hsslam_node.sources.tum import MAX_DT_NS


@dataclass(frozen=True)
class RecordedStamps:
    """Stamps [N], [M] int64 ns in the order of the recording; `depth_ns` is None if both share them."""

    color_ns: np.ndarray
    depth_ns: np.ndarray | None = None
    max_dt_ns: int = MAX_DT_NS  # colour and depth further apart are not paired


def recorded_stamps(spec: str, rows: Sequence[SourceRow] = SOURCES) -> RecordedStamps | None:
    """All stamps of a recording that lists them, such as a TUM folder; None of any other source.

    Raises:
        UserError: the recording or its lists are missing or malformed.
    """
    row = find_row(spec, rows)
    if row is None or row.stamps is None:
        return None
    return RecordedStamps(*imported(row.stamps)(source_name(spec)))


_FAULT_BELOW_HZ = 5.0
_NOTE_BELOW_HZ = 15.0
_FAULT_ABOVE_HZ = 250.0  # stamps in ms or us that were read as seconds, or the other way round
_RATE = Check("rate", "Hz", "15 to 120 Hz")


def check_rate(intervals_ns: np.ndarray) -> Finding:
    """Median rate, Hz, from the intervals [N] int64 ns between consecutive frames."""
    forward = intervals_ns[intervals_ns > 0]
    if len(forward) == 0:
        return _RATE.note(None, "no two consecutive stamps")
    rate_hz = 1e9 / float(np.median(forward))
    seen = f"{rate_hz:.4g} frames a second"
    if rate_hz < _FAULT_BELOW_HZ or rate_hz > _FAULT_ABOVE_HZ:
        advice = (
            "check that the stamps are in seconds; if they are, record faster: the view moves too far "
            "between two frames"
            if rate_hz < _FAULT_BELOW_HZ
            else "check that the stamps are in seconds, and that no stamp is written twice"
        )
        return _RATE.fault(rate_hz, seen, advice)
    if rate_hz < _NOTE_BELOW_HZ:
        advice = "move slowly, or record faster"
        return _RATE.note(rate_hz, seen, advice)
    return _RATE.ok(rate_hz, seen)


def check_stamp_order(intervals_ns: np.ndarray, of: str) -> Finding:
    """Intervals [N] int64 ns between images `of` one kind in the order in which they are recorded."""
    check = Check(f"stamp order, {of}", "stamps", "every stamp later than the one before")
    back, same = int((intervals_ns < 0).sum()), int((intervals_ns == 0).sum())
    if back + same == 0:
        return check.ok(0.0, "every stamp is later than the last")
    seen = f"{back} of {len(intervals_ns) + 1} stamps go back in time, {same} are repeated"
    advice = (
        "stamp images with the time of their exposure, from one clock that never steps, and write them "
        "in that order; a repeated stamp is mostly an image written twice"
    )
    return check.fault(float(back + same), seen, advice)


_LONG_GAP_S = 1.0
_FAULT_MISSING = 0.2
_NOTE_MISSING = 0.02
_STAMP_GAPS = Check("stamp gaps", "%", "less than 2 % of the frames missing, no gap above 1 s")


def check_stamp_gaps(intervals_ns: np.ndarray) -> Finding:
    """Share of dropped frames, %, by the intervals [N] int64 ns."""
    forward = intervals_ns[intervals_ns > 0]
    if len(forward) == 0:
        return _STAMP_GAPS.note(None, "no two consecutive stamps")
    period_ns = float(np.median(forward))
    periods = np.round(forward / period_ns)
    missing = float(np.maximum(periods - 1, 0).sum())
    share = missing / (missing + len(forward))
    longest_s = float(forward.max()) / 1e9
    seen = f"{100 * share:.1f} % of the frames are missing; the longest gap is {longest_s:.3g} s"
    advice = (
        "the recorder drops frames: write to a faster disk, record smaller images, or give the camera "
        "a USB port of its own; after a long gap the tracker must relocalise"
    )
    if share > _FAULT_MISSING or (longest_s > _LONG_GAP_S and longest_s > 5e-9 * period_ns):
        return _STAMP_GAPS.fault(100 * share, seen, advice)
    if share > _NOTE_MISSING:
        return _STAMP_GAPS.note(100 * share, seen, advice)
    return _STAMP_GAPS.ok(100 * share, seen)


_JITTER_FAULT = 0.10  # of the period: 2.4 ms a stamp at 30 Hz
_JITTER_NOTE = 0.05  # a Kinect whose driver stamps in steps of 4 ms has 0.06
_DROPPED = 1.5  # periods; an interval longer than that is a dropped frame
_LEAST_INTERVALS = 10


def check_stamp_jitter(intervals_ns: np.ndarray, of: str) -> Finding:
    """Deviation of the intervals [N] int64 ns between images `of` one kind, ms.

    Dropped frames do not count: an interval of about n periods is compared with n periods.
    """
    check = Check(f"stamp jitter, {of}", "ms", "below 10 % of the period")
    forward = intervals_ns[intervals_ns > 0].astype(np.float64)
    if len(forward) < _LEAST_INTERVALS:
        return check.note(None, "too few stamps to measure")
    period_ns = float(np.median(forward))
    single = forward[forward < _DROPPED * period_ns]
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
        "use the sensor's own stamps instead of the time of arrival; without them, stamp frame n of "
        "a camera with a steady clock as n / rate"
    )
    if share > _JITTER_FAULT:
        return check.fault(jitter_ms, seen, advice)
    if share > _JITTER_NOTE:
        return check.note(jitter_ms, seen, advice)
    return check.ok(jitter_ms, seen)


_FAULT_ALONE = 0.10
_NOTE_ALONE = 0.02
# two cameras of 30 Hz without a common trigger are up to 17 apart
_NOTE_APART_MS = 10.0
_ASSOCIATION = Check(
    "association", "%", "a depth image within 20 ms of every colour image, 10 ms at the median"
)


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
        advice = "record colour and depth together; a run skips images without a partner"
        if abs(offset_ms) > max_dt_ns / 2e6:
            advice = (
                f"depth stamps lie {offset_ms:+.1f} ms from colour throughout: if both share a clock, "
                "correct that offset in one of the lists"
            )
        return _ASSOCIATION.fault(100 * alone, seen, advice)
    if alone > _NOTE_ALONE or apart_ms > _NOTE_APART_MS:
        advice = "trigger colour and depth together if the sensor can; else move slowly"
        return _ASSOCIATION.note(100 * alone, seen, advice)
    return _ASSOCIATION.ok(100 * alone, seen)


def _to_nearest_ns(a_ns: np.ndarray, b_ns: np.ndarray) -> np.ndarray:
    """From each of a [N] to the nearest of b, [N] int64 ns."""
    b_ns = np.sort(b_ns)
    after = np.clip(np.searchsorted(b_ns, a_ns), 1, max(len(b_ns) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(b_ns) - 1)
    nearer = np.abs(b_ns[after] - a_ns) < np.abs(b_ns[before] - a_ns)
    return np.where(nearer, b_ns[after], b_ns[before]) - a_ns
