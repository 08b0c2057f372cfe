"""A map on the device, as those who only ask it need it."""

from dataclasses import dataclass

from torch import Tensor

from hsslam_node.gpu_kernels.gpu_layout import GpuLayout


@dataclass(frozen=True)
class DeviceMap:
    """Parameters on the device and where everything lies in them."""

    layout: GpuLayout
    params: Tensor  # [P], or their geometry prefix
