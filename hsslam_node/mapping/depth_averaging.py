"""Which depth a ray is given: its pixel's, or that of the pixels around it where the sensor is noisy."""

from hsslam_node.map.depth_noise import EXACT_NOISE, depth_noise
from hsslam_node.map.store import KeyframeStore

_DEVIATIONS = 2.0  # of the noise; a pair whose mean is off by more is not on the same surface


class DepthAveraging:
    """How far around a pixel depth is averaged, and what counts as the same surface in each keyframe.

    An iteration sees few rays of a far surface, each with centimetres of noise. The noise of inverse depth
    is the same near and far, and inverse depth is linear on a plane, so the mean of pixels on opposite
    sides lies on the plane (`kernels/ray_batch.py`).
    """

    def __init__(self, window_px: int) -> None:
        self.radius_px = window_px // 2
        self._same_surface: dict[int, float] = {}

    def same_surface(self, store: KeyframeStore, keyframe: int) -> float:
        """Most difference of inverse depth, 1/m, on one surface; 0: depth is taken as measured."""
        if self.radius_px == 0:
            return 0.0
        if keyframe not in self._same_surface:
            noise = depth_noise(store.frame(keyframe))
            self._same_surface[keyframe] = 0.0 if noise < EXACT_NOISE else _DEVIATIONS * noise
        return self._same_surface[keyframe]
