"""Queries of a trained map on the GPU: twin of `MapQueries`."""

import threading

import numpy as np
import torch

from hsslam_node.device.device import Device
from hsslam_node.gpu_kernels.field.activations import field_activations
from hsslam_node.gpu_kernels.field.forward import field_forward
from hsslam_node.gpu_kernels.field.layout import gpu_layout
from hsslam_node.gpu_kernels.field.sdf_query import query_sdf
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.map.layout import FieldLayout
from hsslam_node.meshing.field_answers import FieldAnswers

_CHUNK = 1 << 16


class GpuMapQueries:
    """Signed distance and colour of the map at any points; it copies `params` [P] to the device."""

    threads = 1

    def __init__(self, layout: FieldLayout, params: np.ndarray, device: Device) -> None:
        self._on = device.tensors_on
        self._layout = gpu_layout(kernel_layout(layout), self._on)
        self._params = torch.from_numpy(params).to(self._on)
        self._activations = field_activations(self._layout, 0)
        self._coloring = threading.Lock()  # of the activations

    def sdf(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [N], in units of the truncation, at points [N, 3] float32 m, world."""
        return self._ask(points, with_gradient=False).sdf

    def sdf_and_gradient(self, points: np.ndarray) -> FieldAnswers:
        """The same with its gradient, at points [N, 3] float32 m, world."""
        return self._ask(points, with_gradient=True)

    def color(self, points: np.ndarray) -> np.ndarray:
        """RGB [N, 3], 0..1, at points [N, 3] float32 m, world."""
        colors = np.empty((len(points), 3), np.float32)
        with self._coloring:
            most = min(len(points), _CHUNK)
            if len(self._activations.sdf) < most:
                self._activations = field_activations(self._layout, most)
            for start in range(0, len(points), _CHUNK):
                sent = self._sent(points[start : start + _CHUNK])
                field_forward(self._params, self._layout, sent, len(sent), self._activations)
                colors[start : start + _CHUNK] = self._activations.rgb[: len(sent)].cpu().numpy()
        return colors

    def _ask(self, points: np.ndarray, *, with_gradient: bool) -> FieldAnswers:
        n = len(points)
        sdf = torch.empty(n, device=self._on)
        inside = torch.empty(n, dtype=torch.uint8, device=self._on)
        gradient = torch.empty(n if with_gradient else 0, 3, device=self._on)
        sent = self._sent(points)
        query_sdf(self._params, self._layout, sent, sdf, inside, gradient, with_gradient)
        return FieldAnswers(sdf.cpu().numpy(), gradient.cpu().numpy())

    def _sent(self, points: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(points, np.float32)).to(self._on)
