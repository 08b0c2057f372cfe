"""Checks of images: readable, well exposed, sharp, no repeats, not too much motion."""

from collections.abc import Sequence

import cv2
import numpy as np

from hsslam_node.doctor.finding import Check, Finding

_UNREADABLE_SHARE = 0.05
_READABLE = Check("images", "%", "every image whole and of the camera's size, depth of 16 bit")


def check_readable(read: int, reasons: Sequence[str]) -> Finding:
    """`read`: frames that could be read; `reasons`: one line for each that could not."""
    looked_at = read + len(reasons)
    if not reasons:
        seen = f"all of {looked_at} frames could be read"
        return _READABLE.ok(0.0, seen)
    share = len(reasons) / looked_at
    seen = f"{len(reasons)} of {looked_at} frames cannot be read; the first: {reasons[0]}"
    advice = (
        "frames that cannot be read are skipped: copy or export them again; if all have another "
        "size, correct width, height and the intrinsics in the camera file"
    )
    finding = _READABLE.fault if share > _UNREADABLE_SHARE else _READABLE.note
    return finding(100 * share, seen, advice)


_FAULT_SIDE_PX, _NOTE_SIDE_PX = 48, 120
_SIZE = Check("image size", "px", "images of 160x120 pixels or more")


def check_image_size(width_px: int, height_px: int) -> Finding:
    """The shorter side of the images, px."""
    side, seen = float(min(width_px, height_px)), f"images of {width_px}x{height_px} pixels"
    advice = "choose a larger size of image in the camera's driver, 640x480 for best results"
    if side < _FAULT_SIDE_PX:
        return _SIZE.fault(side, f"{seen}: poses are wrong or lost", advice)
    if side < _NOTE_SIDE_PX:
        return _SIZE.note(side, f"{seen}: poses are less accurate", advice)
    return _SIZE.ok(side, seen)


_DARK, _BRIGHT = 8, 250
_FAULT_FLAT = 0.9  # black or white all over: the lens is covered, or there is no light
_NOTE_FLAT = 0.35
_DARK_MEAN = 40.0
_NOTE_JUMP = 0.10
_EXPOSURE = Check(
    "exposure", "%", "below 35 % of the pixels black or white, brightness steady within 10 %"
)


def check_exposure(
    images: Sequence[np.ndarray], pairs: Sequence[tuple[np.ndarray, np.ndarray]]
) -> Finding:
    """Median share of pixels that are black or white, %; images [H, W, 3] uint8, and consecutive pairs."""
    if not images:
        return _EXPOSURE.note(None, "no frame could be read")
    greens = [image[::4, ::4, 1] for image in images]
    flat = float(np.median([np.mean((g < _DARK) | (g > _BRIGHT)) for g in greens]))
    mean = float(np.median([g.mean() for g in greens]))
    jumps = [
        abs(b[::4, ::4].mean() / max(a[::4, ::4].mean(), 1e-9) - 1) for a, b in pairs if a.any()
    ]
    jump = float(np.percentile(jumps, 95)) if jumps else 0.0
    seen = (
        f"{100 * flat:.0f} % of the pixels are black or white, mean grey level {mean:.0f} of 255; "
        f"brightness changes by {100 * jump:.1f} % a frame at most"
    )
    if flat > _FAULT_FLAT:
        advice = (
            "images are blank: check that the lens is free, the light on, the exposure automatic"
        )
        return _EXPOSURE.fault(100 * flat, seen, advice)
    if flat > _NOTE_FLAT or mean < _DARK_MEAN or jump > _NOTE_JUMP:
        advice = "more light, fixed exposure and white balance; avoid windows in the picture"
        return _EXPOSURE.note(100 * flat, seen, advice)
    return _EXPOSURE.ok(100 * flat, seen)


_BLURRED = 0.3  # of the sharpness of the sharpest tenth
_SHARPNESS_NOTE_ABOVE = 0.4
_SHARPNESS = Check("sharpness", "%", "below 40 % of the images blurred")


def check_sharpness(images: Sequence[np.ndarray]) -> Finding:
    """Share of images [H, W, 3] uint8, %, with much weaker edges than the sharpest tenth.

    A bare wall looks like blur, so this reports a note at most.
    """
    if not images:
        return _SHARPNESS.note(None, "no frame could be read")
    found = np.array([_edge_strength(image) for image in images])
    blurred = float((found < _BLURRED * np.percentile(found, 90)).mean())
    seen = f"{100 * blurred:.0f} % of the images have much weaker edges than the sharpest"
    if blurred > _SHARPNESS_NOTE_ABOVE:
        advice = (
            "more light or a shorter exposure, slower motion; or the camera looks at bare walls"
        )
        return _SHARPNESS.note(100 * blurred, seen, advice)
    return _SHARPNESS.ok(100 * blurred, seen)


def _edge_strength(color: np.ndarray) -> float:
    """99th percentile of |Laplacian|, grey levels: the strongest edges, however few."""
    grey = cv2.GaussianBlur(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), (0, 0), 0.8)
    return float(np.percentile(np.abs(cv2.Laplacian(grey, cv2.CV_32F))[::2, ::2], 99))


_REPEATED_FAULT_ABOVE = 0.30  # a Kinect that is read faster than it delivers has 0.1
_REPEATED_IMAGES = Check("repeated images", "%", "no image twice")


def check_repeated_images(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> Finding:
    """Share of consecutive images, %, that are the same to the last bit; pairs of arrays of one shape."""
    if not pairs:
        return _REPEATED_IMAGES.note(None, "no two consecutive frames")
    share = float(np.mean([np.array_equal(a, b) for a, b in pairs]))
    seen = f"{100 * share:.0f} % of the images are copies of the one before"
    if share > _REPEATED_FAULT_ABOVE:
        advice = "the camera or recorder repeats frames to keep its rate: record at its true rate"
        return _REPEATED_IMAGES.fault(100 * share, seen, advice)
    if share > 0:
        return _REPEATED_IMAGES.note(100 * share, seen)
    return _REPEATED_IMAGES.ok(0.0, seen)


_WIDTH_PX = 320
_MOTION_FAULT_ABOVE, _MOTION_NOTE_ABOVE = 0.10, 0.04  # of the width
_VIEW_MOTION = Check("motion of the view", "%", "below 4 % of the width a frame")


def check_view_motion(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> Finding:
    """95th percentile of the median optical flow, % of the width; pairs of colour [H, W, 3] uint8 RGB."""
    if not pairs:
        return _VIEW_MOTION.note(None, "no two consecutive frames")
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    moved = []
    for first, second in pairs:
        a, b = _small(first), _small(second)
        u = np.zeros((*a.shape, 2), np.float32)
        u = flow.calc(a, b, u)
        moved.append(float(np.median(np.linalg.norm(u, axis=2))) / a.shape[1])
    median, fast = float(np.median(moved)), float(np.percentile(moved, 95))
    seen = f"the view moves by {100 * median:.2f} % of the width a frame, {100 * fast:.2f} % at its fastest"
    advice = "move and above all turn more slowly, or record at a higher rate"
    if fast > _MOTION_FAULT_ABOVE:
        return _VIEW_MOTION.fault(100 * fast, seen, advice)
    if fast > _MOTION_NOTE_ABOVE:
        return _VIEW_MOTION.note(100 * fast, seen, advice)
    return _VIEW_MOTION.ok(100 * fast, seen)


def _small(color: np.ndarray) -> np.ndarray:
    height = max(round(color.shape[0] * _WIDTH_PX / color.shape[1]), 32)
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    return cv2.resize(grey, (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
