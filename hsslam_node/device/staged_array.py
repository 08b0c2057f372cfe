"""An array on the host and its copy on the device; alone, as mapping and tracking share it."""

import numpy as np
import torch
from torch import Tensor

from hsslam_node.device.device import Device


class StagedArray:
    """An array on the host (`host`, page-locked for CUDA) and its copy on the device (`tensor`).

    Neither ever moves. Without CUDA both share their memory.
    """

    def __init__(self, shape: tuple[int, ...], dtype: torch.dtype, device: Device) -> None:
        is_cuda = device.kind == "cuda"
        self._host = torch.zeros(shape, dtype=dtype, pin_memory=is_cuda)
        self.tensor: Tensor = self._host.cuda() if is_cuda else self._host
        self.host: np.ndarray = self._host.numpy()

    def send(self, rows: int | None = None) -> None:
        """Copy the first rows (all, if none is given) to the device.

        Does not wait: `host` must not change before the caller has waited for the device.
        """
        if self.tensor is not self._host:
            self.tensor[:rows].copy_(self._host[:rows], non_blocking=True)

    def fetch(self, rows: int | None = None) -> np.ndarray:
        """Wait for the device and copy its first rows to `host`; returns a view of them."""
        if self.tensor is not self._host:
            self._host[:rows].copy_(self.tensor[:rows])
        return self.host[:rows]
