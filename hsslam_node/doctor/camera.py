"""Checks of the camera: its intrinsics, whether depth lies on colour, how it moves."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.doctor.finding import Check, Finding
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import FAR_OFF_CENTRE, Camera
from hsslam_node.tracking.odometry import rgbd_odometry

_NOTE_CENTRE = 0.06  # of the image's width or height
_FAULT_ASPECT, _NOTE_ASPECT = 0.10, 0.03
# horizontal field of view of RGB-D cameras; Kinect 57 to 63, T265-like 110
_VIEW_DEG = (35.0, 125.0)
_INTRINSICS = Check(
    "intrinsics",
    "degrees",
    "35 to 125 degrees across, square pixels, principal point near the middle",
)


def check_intrinsics(camera: Camera) -> Finding:
    """Horizontal field of view, degrees; also checks the principal point, and fx against fy."""
    view_deg = math.degrees(2 * math.atan(camera.width_px / (2 * camera.fx)))
    off_x, off_y = camera.off_centre
    off = max(abs(off_x), abs(off_y))
    aspect = abs(camera.fx / camera.fy - 1)
    seen = (
        f"{camera.width_px}x{camera.height_px} pixels, {view_deg:.0f} degrees across; principal point "
        f"{100 * off_x:+.1f} % / {100 * off_y:+.1f} % off the middle; fx / fy = {camera.fx / camera.fy:.3f}"
    )
    wide = not _VIEW_DEG[0] <= view_deg <= _VIEW_DEG[1]
    if wide or off > FAR_OFF_CENTRE or aspect > _FAULT_ASPECT:
        advice = (
            "the intrinsics belong to another image size or camera: fx, fy, cx, cy scale with the "
            "image (half the width: half of fx and cx)"
        )
        return _INTRINSICS.fault(view_deg, seen, advice)
    if off > _NOTE_CENTRE or aspect > _NOTE_ASPECT:
        advice = (
            "correct if the image was cropped or stretched; otherwise calibrate the camera again"
        )
        return _INTRINSICS.note(view_deg, seen, advice)
    return _INTRINSICS.ok(view_deg, seen)


_FAULT_PX, _NOTE_PX = 4.0, 2.0  # of an image 640 pixels wide


def check_registration(images: Sequence[tuple[np.ndarray, np.ndarray]]) -> Finding:
    """Offset of colour from depth, pixels; pairs of colour [H, W, 3] uint8 and depth [H, W] m (0 = none).

    Shifts of up to 24 pixels (of 640) are found, and depth of another view or moment; a depth image of
    another focal length is not.
    """
    factor = images[0][0].shape[1] / 640 if images else 1.0
    check = Check(
        "registration", "px", f"edges of depth and colour within {_NOTE_PX * factor:.1f} pixels"
    )
    shifts = edge_shifts(images)
    clear = [s for s in shifts or () if s.clear]
    if shifts is None or not clear:
        return _without_shift(check, shifts, REACH_PX * factor)
    words = [
        f"{abs(s.shift_px):.1f} px {after if s.shift_px > 0 else before}"
        if s.clear
        else f"unclear {where}"
        for s, before, after, where in (
            (shifts[0], "left of", "right of", "in x"),
            (shifts[1], "above", "below", "in y"),
        )
    ]
    off = max(abs(s.shift_px) for s in clear)
    seen = f"edges of colour lie {words[0]} and {words[1]} those of depth"
    advice = (
        "register depth to colour with the sensor's own driver (depth_registration, align_to_color), or "
        "shift one of the images by as much; nothing must crop or flip only one of them"
    )
    if off >= (REACH_PX - 1) * factor:
        seen += " or further"
    if off >= _FAULT_PX * factor:
        return check.fault(off, seen, advice)
    if off >= _NOTE_PX * factor:
        return check.note(off, seen, advice)
    return check.ok(off, seen)


def _without_shift(
    check: Check, shifts: tuple["EdgeShift", "EdgeShift"] | None, reach_px: float
) -> Finding:
    """What is known if no shift within `reach_px` stands out."""
    if shifts is None or not all(s.has_edges for s in shifts):
        seen = "colour and depth share too few edges to check their registration"
        return check.note(None, seen, "check it in the viewer")
    advice = (
        "check that nothing mirrors or turns only one of the two images, that both are of the same time, and "
        "that depth is registered to colour"
    )
    if all(s.contrast < _LEAST_ON_EDGES for s in shifts):
        seen = f"edges of depth lie on no edges of colour within {reach_px:.0f} pixels"
        return check.fault(reach_px, seen, advice)
    seen = f"edges of depth lie on few edges of colour within {reach_px:.0f} pixels"
    return check.note(None, seen, advice)


REACH_PX = 24  # largest shift, in an image 640 pixels wide
_WIDTH_PX = 640
# a jump of depth spans twice that, to bridge a seam without depth
_STEP_PX = 3
_JUMP = 0.10  # of the depth
_BRIGHTEST = 97.0  # percentile that clips gradients: no single edge rules
_AROUND_PX = 41  # size of the surroundings whose mean gradients lose
_PEAK_PX = 9  # around the peak; values outside come by chance
_LEAST_PEAK = 1.8  # of the largest value outside
_LEAST_EDGES = 2000  # pixels
# Measured on kitchen, livingroom, house and built-in scenes: 1.5 at least, also for a frame or five.
_LEAST_ON_EDGES = 1.2  # smaller peaks come by chance
_LEAST_GRADIENT = 100.0  # of Scharr's filter: an edge of 9 grey levels


@dataclass(frozen=True)
class EdgeShift:
    """Along one axis: colour edges lie `shift_px` (full image) right of, or below, depth edges."""

    shift_px: float
    contrast: float  # peak over the largest value away from it
    clear: bool  # enough edges, one peak
    has_edges: bool  # enough in each image, of colour and of depth


def edge_shifts(
    images: Iterable[tuple[np.ndarray, np.ndarray]],
) -> tuple[EdgeShift, EdgeShift] | None:
    """Shifts in x and y over pairs of colour [H, W, 3] uint8 and depth [H, W] m (0 = none).

    For each shift, sums the image gradient at the jumps of depth over all frames; the shift of the peak
    counts, to a fraction of a pixel. None if depth has no jump.
    """
    sums, counts, factor = np.zeros((2, 2 * REACH_PX + 1)), np.zeros(2), 1.0
    brightest: tuple[list[float], list[float]] = ([], [])
    for color, depth_m in images:
        factor = max(color.shape[1] / _WIDTH_PX, 1e-9)
        size = (_WIDTH_PX, max(round(color.shape[0] / factor), 4 * REACH_PX))
        grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        grey = cv2.GaussianBlur(grey, (0, 0), 1.0)
        depth = cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST)
        for axis in (0, 1):  # x, y
            gradient, most = _gradient(grey, axis)
            brightest[axis].append(most)
            jump = _jumps(depth, axis)
            counts[axis] += np.count_nonzero(jump)
            sums[axis] += _sum_by_shift(gradient, jump, axis)
    if not counts.any():
        return None
    x, y = (
        _peak(sums[axis] / max(counts[axis], 1), counts[axis], brightest[axis], factor)
        for axis in (0, 1)
    )
    return x, y


def _gradient(grey: np.ndarray, axis: int) -> tuple[np.ndarray, float]:
    """|gradient| along an axis, clipped, minus the mean around it, [H, W] float32; and its largest value."""
    size = np.abs(cv2.Scharr(grey, cv2.CV_32F, 1 - axis, axis))
    most = float(np.percentile(size[::2, ::2], _BRIGHTEST))
    size = np.minimum(size, most)
    return size - cv2.blur(size, (_AROUND_PX, _AROUND_PX)), most


def _jumps(depth: np.ndarray, axis: int) -> np.ndarray:
    """Pixels in the middle of a jump of depth, away from the border, [h, w] bool."""
    margin = slice(REACH_PX + _STEP_PX, -REACH_PX - _STEP_PX)
    before = np.roll(depth, _STEP_PX, 1 - axis)[margin, margin]
    after = np.roll(depth, -_STEP_PX, 1 - axis)[margin, margin]
    nearer = np.minimum(before, after)
    return (nearer > 0) & (np.abs(before - after) > _JUMP * nearer)


def _sum_by_shift(gradient: np.ndarray, jump: np.ndarray, axis: int) -> np.ndarray:
    """Sum of the gradient at the jumps moved by -REACH_PX to REACH_PX pixels."""
    row, column = (index + REACH_PX + _STEP_PX for index in np.nonzero(jump))
    shifts = range(-REACH_PX, REACH_PX + 1)
    if axis == 0:
        return np.array([gradient[row, column + s].sum() for s in shifts], np.float64)
    return np.array([gradient[row + s, column].sum() for s in shifts], np.float64)


def _peak(curve: np.ndarray, edges: float, brightest: Sequence[float], factor: float) -> EdgeShift:
    """`edges`: pixels at jumps of depth in all images; `brightest`: largest gradient of each image."""
    top = int(np.argmax(curve))
    away = np.abs(np.arange(len(curve)) - top) > _PEAK_PX
    contrast = float(curve[top] / max(np.abs(curve[away]).max(), 1e-9))
    fine = float(top)
    if 0 < top < len(curve) - 1:
        a, b, c = curve[top - 1 : top + 2]
        fine += 0.5 * (a - c) / min(a - 2 * b + c, -1e-9)
    clear = bool(edges >= _LEAST_EDGES and contrast >= _LEAST_PEAK)
    has_edges = bool(
        edges >= _LEAST_EDGES * len(brightest) and np.median(brightest) >= _LEAST_GRADIENT
    )
    return EdgeShift(float(fine - REACH_PX) * factor, contrast, clear, has_edges)


_NOTE_FAILED = 0.3
_NOTE_ABOVE_M_S, _NOTE_ABOVE_DEG_S = 1.5, 120.0
_CAMERA_MOTION = Check("motion of the camera", "m/s", "below 1.5 m/s and 120 degrees/s")


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
        return _CAMERA_MOTION.note(None, seen, advice)
    speed, turn = float(np.median(speeds)), float(np.median(turns))
    seen = f"{speed:.2f} m/s and {turn:.0f} degrees/s at the median"
    if speed > _NOTE_ABOVE_M_S or turn > _NOTE_ABOVE_DEG_S:
        advice = (
            "move more slowly; a hand-held camera this fast hints at a wrong depth scale or rate"
        )
        return _CAMERA_MOTION.note(speed, seen, advice)
    return _CAMERA_MOTION.ok(speed, seen)
