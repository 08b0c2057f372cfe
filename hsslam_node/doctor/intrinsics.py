"""Whether the intrinsics fit the size of the image."""

import math

from hsslam_node.doctor.finding import Finding
from hsslam_node.geometry.camera import Camera

_FAULT_CENTRE, _NOTE_CENTRE = 0.12, 0.06  # of the image's width or height
_FAULT_ASPECT, _NOTE_ASPECT = 0.10, 0.03
_VIEW_DEG = (
    35.0,
    125.0,
)  # horizontal field of view of RGB-D cameras; Kinect 57 to 63, T265-like 110
_NAME = "intrinsics"
_EXPECTED = "35 to 125 degrees across, square pixels, principal point near the middle"


def check_intrinsics(camera: Camera) -> Finding:
    """Field of view across, degrees; also the place of the principal point, and fx against fy."""
    view_deg = math.degrees(2 * math.atan(camera.width_px / (2 * camera.fx)))
    off_x = (camera.cx + 0.5) / camera.width_px - 0.5
    off_y = (camera.cy + 0.5) / camera.height_px - 0.5
    off = max(abs(off_x), abs(off_y))
    aspect = abs(camera.fx / camera.fy - 1)
    seen = (
        f"{camera.width_px}x{camera.height_px} pixels, {view_deg:.0f} degrees across; principal point "
        f"{100 * off_x:+.1f} % / {100 * off_y:+.1f} % off the middle; fx / fy = {camera.fx / camera.fy:.3f}"
    )
    wide = not _VIEW_DEG[0] <= view_deg <= _VIEW_DEG[1]
    if wide or off > _FAULT_CENTRE or aspect > _FAULT_ASPECT:
        advice = (
            "the intrinsics belong to another image size or camera: fx, fy, cx, cy scale with the "
            "image (half the width: half of fx and cx)"
        )
        return Finding(_NAME, "fault", view_deg, "degrees", seen, _EXPECTED, advice)
    if off > _NOTE_CENTRE or aspect > _NOTE_ASPECT:
        advice = "right for an image that was cropped or stretched; otherwise calibrate again"
        return Finding(_NAME, "note", view_deg, "degrees", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", view_deg, "degrees", seen, _EXPECTED)
