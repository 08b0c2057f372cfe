"""Whether depth lies where indoor depth lies."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.doctor.finding import Finding

_FAULT_BELOW_M, _NOTE_BELOW_M = 0.40, 0.60  # nearest that structured light measures: 0.35 to 0.8 m
_NOTE_ABOVE_M, _FAULT_ABOVE_M = 5.0, 8.0
_FULL, _FULL_SHARE = 65535, 0.01
_NAME, _EXPECTED = "depth range", "median of 0.6 to 5 m"


def check_depth_range(depths_raw: Sequence[np.ndarray], units_per_m: float) -> Finding:
    """Median depth, m, of images [H, W] uint16 (0 = none) of `units_per_m`.

    Plausibility alone: a scale that is wrong but leaves the room between a box and a hall is not found.
    """
    values = [depth[::4, ::4] for depth in depths_raw]
    raw = np.concatenate([v[v > 0] for v in values]) if values else np.zeros(0, np.uint16)
    if raw.size == 0:
        return Finding(_NAME, "note", None, "m", "no pixel has depth", _EXPECTED)
    full = float((raw == _FULL).mean())
    if full > _FULL_SHARE:
        seen = f"{100 * full:.0f} % of the depth pixels hold 65535, the largest number there is"
        advice = "write 0, not 65535, where nothing was measured; or use fewer units per metre"
        return Finding(_NAME, "fault", _FULL / units_per_m, "m", seen, _EXPECTED, advice)
    near_m, median_m, far_m = np.percentile(raw, (1, 50, 99)) / units_per_m
    seen = (
        f"depth of {near_m:.2f} to {far_m:.2f} m (1st and 99th percentile), median {median_m:.2f} m"
    )
    value = float(median_m)
    if value < _FAULT_BELOW_M or value > _FAULT_ABOVE_M:
        how = "small: too many" if value < _FAULT_BELOW_M else "large: too few"
        advice = (
            f"depths look too {how} units per metre ({units_per_m:g}) are assumed: correct the depth scale "
            "(common: 1000 for mm, 5000 in TUM, 6553.5 in Replica)"
        )
        return Finding(_NAME, "fault", value, "m", seen, _EXPECTED, advice)
    if value < _NOTE_BELOW_M or value > _NOTE_ABOVE_M:
        advice = (
            f"measure something known: is the depth scale of {units_per_m:g} units per metre right?"
        )
        return Finding(_NAME, "note", value, "m", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", value, "m", seen, _EXPECTED)
