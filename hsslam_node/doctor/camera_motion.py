"""How the camera moves, by RGB-D odometry."""

from collections.abc import Sequence

import numpy as np

from hsslam_node.doctor.finding import Finding
from hsslam_node.frame import Frame
from hsslam_node.tracking.odometry import rgbd_odometry

_NOTE_FAILED = 0.3
_NOTE_ABOVE_M_S, _NOTE_ABOVE_DEG_S = 1.5, 120.0
_NAME, _EXPECTED = "motion of the camera", "below 1.5 m/s and 120 degrees/s"


def check_camera_motion(pairs: Sequence[tuple[Frame, Frame]]) -> Finding:
    """Median speed, m/s, by dense alignment of consecutive frames."""
    speeds, turns = [], []
    for first, second in pairs:
        T_first_second = rgbd_odometry(first, second)
        dt_s = (second.stamp_ns - first.stamp_ns) / 1e9
        if T_first_second is None or dt_s <= 0:
            continue
        cosine = (np.trace(T_first_second[:3, :3]) - 1) / 2
        speeds.append(float(np.linalg.norm(T_first_second[:3, 3])) / dt_s)
        turns.append(float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))) / dt_s)
    failed = 1 - len(speeds) / len(pairs) if pairs else 1.0
    if not speeds or failed > _NOTE_FAILED:
        seen = f"{100 * failed:.0f} % of {len(pairs)} consecutive pairs cannot be aligned"
        advice = (
            "see the other findings: coverage, registration, motion of the view, scale of depth"
        )
        return Finding(_NAME, "note", None, "m/s", seen, _EXPECTED, advice)
    speed, turn = float(np.median(speeds)), float(np.median(turns))
    seen = f"{speed:.2f} m/s and {turn:.0f} degrees/s at the median"
    if speed > _NOTE_ABOVE_M_S or turn > _NOTE_ABOVE_DEG_S:
        advice = (
            "move more slowly; a hand-held camera this fast hints at a wrong depth scale or rate"
        )
        return Finding(_NAME, "note", speed, "m/s", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", speed, "m/s", seen, _EXPECTED)
