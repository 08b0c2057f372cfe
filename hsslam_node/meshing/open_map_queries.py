"""The functions that meshing asks, wherever they are computed."""

from typing import Protocol

import numpy as np

from hsslam_node.device.device import Device
from hsslam_node.map.layout import FieldLayout
from hsslam_node.meshing.map_queries import MapQueries


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
