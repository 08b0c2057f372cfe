"""Depth images and poses of cameras as a sequence; apart, as not only meshing reads them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np


class DepthViews(Sequence[tuple[np.ndarray, np.ndarray]]):
    """Depth [H, W] float32 m and T_world_cam [4, 4] of each camera.

    Args:
        depth_m: gives the depth of camera k.
        T_world_cam: [N, 4, 4].
    """

    def __init__(self, depth_m: Callable[[int], np.ndarray], T_world_cam: np.ndarray) -> None:
        self._depth_m = depth_m
        self._T_world_cam = T_world_cam

    def __len__(self) -> int:
        return len(self._T_world_cam)

    def __getitem__(self, k: Any) -> Any:
        if not 0 <= k < len(self):
            raise IndexError(k)
        # a copy, as kernels compile once more for read-only arrays
        return self._depth_m(k), self._T_world_cam[k].copy()
