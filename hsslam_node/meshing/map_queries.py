"""Queries of a trained map, on the CPU or on a GPU."""

import os
import threading
from typing import Protocol

import numpy as np

from hsslam_node.device.device import Device
from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.forward import field_forward
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.kernels.field.sdf_query import query_sdf
from hsslam_node.map.layout import FieldLayout
from hsslam_node.meshing.field_answers import FieldAnswers

_CHUNK = 1 << 14
_MOST_THREADS = 8


class MapQueries:
    """Signed distance and colour of the map at any points; it reads `params` [P] in place.

    `threads`: number of threads that may query in parallel.
    """

    threads = min(len(os.sched_getaffinity(0)), _MOST_THREADS)

    def __init__(self, layout: FieldLayout, params: np.ndarray) -> None:
        self._layout = kernel_layout(layout)
        self._params = params
        self._of_thread = threading.local()  # activations of a thread, 13 MB

    def sdf(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [N], in units of the truncation, at points [N, 3] float32 m, world."""
        return self._ask(points, np.empty((0, 3), np.float32)).sdf

    def sdf_and_gradient(self, points: np.ndarray) -> FieldAnswers:
        """The same with its gradient, at points [N, 3] float32 m, world."""
        return self._ask(points, np.empty((len(points), 3), np.float32))

    def color(self, points: np.ndarray) -> np.ndarray:
        """RGB [N, 3], 0..1, at points [N, 3] float32 m, world."""
        points = np.ascontiguousarray(points, np.float32)
        colors = np.empty((len(points), 3), np.float32)
        if not hasattr(self._of_thread, "activations"):
            self._of_thread.activations = field_activations(self._layout, _CHUNK)
        activations = self._of_thread.activations
        for start in range(0, len(points), _CHUNK):
            chunk = points[start : start + _CHUNK]
            field_forward(self._params, self._layout, chunk, len(chunk), activations)
            colors[start : start + _CHUNK] = activations.rgb[: len(chunk)]
        return colors

    def _ask(self, points: np.ndarray, gradient: np.ndarray) -> FieldAnswers:
        n = len(points)
        sdf, inside = np.empty(n, np.float32), np.empty(n, np.uint8)
        points = np.ascontiguousarray(points, np.float32)
        if n > 0:
            query_sdf(self._params, self._layout, points, sdf, inside, gradient, len(gradient) > 0)
        return FieldAnswers(sdf, gradient)


class Queries(Protocol):
    """Signed distance and colour of a map; see `MapQueries`."""

    threads: int

    def sdf(self, points: np.ndarray) -> np.ndarray: ...

    def sdf_and_gradient(self, points: np.ndarray) -> FieldAnswers: ...

    def color(self, points: np.ndarray) -> np.ndarray: ...


def open_map_queries(layout: FieldLayout, params: np.ndarray, device: Device) -> Queries:
    """Open queries of the map of `params` [P] on the device; `params` must not change meanwhile."""
    if device.uses_triton:
        from hsslam_node.meshing.gpu_map_queries import GpuMapQueries

        return GpuMapQueries(layout, params, device)
    return MapQueries(layout, params)
