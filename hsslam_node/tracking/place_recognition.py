"""Which keyframes look like a frame: small blurred images compared (Klein and Murray, 2008)."""

import cv2
import numpy as np

from hsslam_node.keyframes.store import KeyframeStore

_SIZE_PX = (40, 30)


class PlaceRecognition:
    """Thumbnails of all keyframes of a store, taken in as they come."""

    def __init__(self, store: KeyframeStore) -> None:
        self._store = store
        self._thumbnails: list[np.ndarray] = []

    def nearest(self, color: np.ndarray, wanted: int) -> list[int]:
        """Ids of the `wanted` keyframes most like a colour image [H, W, 3], best first."""
        while len(self._thumbnails) < self._store.count:
            self._thumbnails.append(_thumbnail(self._store.pixels(len(self._thumbnails))[0]))
        if not self._thumbnails:
            return []
        similarity = np.stack(self._thumbnails) @ _thumbnail(color)
        return [int(k) for k in np.argsort(-similarity, kind="stable")[:wanted]]


def _thumbnail(color: np.ndarray) -> np.ndarray:
    """Blurred grey image [1200] of zero mean and unit length, so that a product is a correlation."""
    grey = cv2.resize(
        cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), _SIZE_PX, interpolation=cv2.INTER_AREA
    )
    small = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.5).ravel()
    small -= small.mean()
    return small / max(float(np.linalg.norm(small)), 1e-6)
