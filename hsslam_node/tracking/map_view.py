"""The published map that a frame is tracked against."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hsslam_node.kernels.kernel_layout import KernelLayout

if TYPE_CHECKING:
    from hsslam_node.device.device_map import DeviceMap


@dataclass(frozen=True)
class MapView:
    """One version of the map."""

    version: int
    layout: KernelLayout
    params: np.ndarray  # [P] float32, used in place
    truncation_m: float
    on_device: "DeviceMap | None" = None  # its copy on a GPU, which is asked instead
