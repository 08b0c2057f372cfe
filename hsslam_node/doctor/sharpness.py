"""Whether some images are blurred against the others."""

from collections.abc import Sequence

import cv2
import numpy as np

from hsslam_node.doctor.finding import Finding

_BLURRED = 0.3  # of the sharpness of the sharpest tenth
_NOTE_ABOVE = 0.4
_NAME, _EXPECTED = "sharpness", "below 40 % of the images blurred"


def check_sharpness(images: Sequence[np.ndarray]) -> Finding:
    """Share of images [H, W, 3] uint8, %, with much weaker edges than the sharpest tenth.

    Blur and a bare wall look alike to it: never more than a note.
    """
    if not images:
        return Finding(_NAME, "note", None, "%", "no frame could be read", _EXPECTED)
    found = np.array([_edge_strength(image) for image in images])
    blurred = float((found < _BLURRED * np.percentile(found, 90)).mean())
    seen = f"{100 * blurred:.0f} % of the images have much weaker edges than the sharpest"
    if blurred > _NOTE_ABOVE:
        advice = (
            "more light or a shorter exposure, slower motion; or the camera looks at bare walls"
        )
        return Finding(_NAME, "note", 100 * blurred, "%", seen, _EXPECTED, advice)
    return Finding(_NAME, "ok", 100 * blurred, "%", seen, _EXPECTED)


def _edge_strength(color: np.ndarray) -> float:
    """99th percentile of |Laplacian|, grey levels: the strongest edges, however few."""
    grey = cv2.GaussianBlur(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), (0, 0), 0.8)
    return float(np.percentile(np.abs(cv2.Laplacian(grey, cv2.CV_32F))[::2, ::2], 99))
