"""A trained map as the two functions that meshing asks, on the CPU or on a GPU."""

from typing import Protocol

import numpy as np

from hsslam_node.device.device import Device
from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.forward import field_forward
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.kernels.field.sdf_query import query_sdf
from hsslam_node.map.layout import FieldLayout

_CHUNK = 1 << 16


class MapQueries:
    """Signed distance and colour of the map at any points; `params` [P] are read in place."""

    def __init__(self, layout: FieldLayout, params: np.ndarray) -> None:
        self._layout = kernel_layout(layout)
        self._params = params
        self._activations = field_activations(self._layout, _CHUNK)

    def sdf(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [N], in units of the truncation, at points [N, 3] float32 m, world."""
        n = len(points)
        sdf, inside = np.empty(n, np.float32), np.empty(n, np.uint8)
        no_gradient = np.empty((0, 3), np.float32)
        points = np.ascontiguousarray(points, np.float32)
        query_sdf(self._params, self._layout, points, sdf, inside, no_gradient, False)
        return sdf

    def color(self, points: np.ndarray) -> np.ndarray:
        """RGB [N, 3], 0..1, at points [N, 3] float32 m, world."""
        points = np.ascontiguousarray(points, np.float32)
        colors = np.empty((len(points), 3), np.float32)
        for start in range(0, len(points), _CHUNK):
            chunk = points[start : start + _CHUNK]
            field_forward(self._params, self._layout, chunk, len(chunk), self._activations)
            colors[start : start + _CHUNK] = self._activations.rgb[: len(chunk)]
        return colors


class Queries(Protocol):
    """Signed distance and colour of a map; see `MapQueries`."""

    def sdf(self, points: np.ndarray) -> np.ndarray: ...

    def color(self, points: np.ndarray) -> np.ndarray: ...


def open_map_queries(layout: FieldLayout, params: np.ndarray, device: Device) -> Queries:
    """Ask the map of `params` [P] on the device; they must stay as they are meanwhile."""
    if device.uses_triton:
        from hsslam_node.meshing.gpu_map_queries import GpuMapQueries

        return GpuMapQueries(layout, params, device)
    return MapQueries(layout, params)
