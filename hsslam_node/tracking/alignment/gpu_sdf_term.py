"""The SDF term of an alignment on a GPU.

Twin: `CpuSdfTerm` in `sdf_term.py`.
"""

import numpy as np
import torch

from hsslam_node.config import TrackerConfig
from hsslam_node.gpu_kernels.tracking.alignment import alignment_work_space, sdf_normal_equations
from hsslam_node.tracking.alignment.sdf_term import SdfEvidence
from hsslam_node.tracking.map_view import MapView

_H, _B, _SUMS = slice(0, 49), slice(49, 56), slice(56, 60)


class GpuSdfTerm:
    """Queries the device's copy of the map; an `SdfTerm`."""

    def __init__(
        self, view: MapView, points: tuple[np.ndarray, np.ndarray], config: TrackerConfig
    ) -> None:
        assert view.on_device is not None
        self._map = view.on_device
        self._truncation_m = view.truncation_m
        self._config = config
        device = self._map.params.device
        self._points = tuple(torch.from_numpy(p).to(device) for p in points)
        self._counts = torch.tensor([len(p) for p in points], dtype=torch.int32, device=device)
        self._partial = alignment_work_space(self._map.layout, len(points[-1]))
        self._result = torch.empty(60, dtype=torch.float64, device=device)  # H, b, sums

    def add(
        self, T_world_cam: np.ndarray, world: np.ndarray, fine: bool, H: np.ndarray, b: np.ndarray
    ) -> SdfEvidence:
        c, result = self._config, self._result
        pose = torch.from_numpy(T_world_cam[:3].astype(np.float32)).to(result.device)
        sdf_normal_equations(
            self._map.params, self._map.layout, self._points[fine],
            self._counts[int(fine) : int(fine) + 1], pose, self._truncation_m,
            c.sdf_sigma_m, c.sdf_sigma_slope, c.sdf_huber_m, self._partial,
            result[_H].view(7, 7), result[_B], result[_SUMS],
        )  # fmt: skip
        found = result.cpu().numpy()
        H[:7, :7] += found[_H].reshape(7, 7)
        b[:7] += found[_B]
        _cost, inliers, seen, squares = found[_SUMS]
        return SdfEvidence(round(inliers), round(seen), float(squares))
