"""An array that the host fills and the device reads."""

import numpy as np
import torch
from torch import Tensor

from hsslam_node.device.device import Device


class StagedArray:
    """The same array twice: `host` to write into, page-locked where that helps, `tensor` on the device.

    Both stay where they are for life. Where the device shares the host's memory they are one.
    """

    def __init__(self, shape: tuple[int, ...], dtype: torch.dtype, device: Device) -> None:
        is_cuda = device.kind == "cuda"
        self._host = torch.zeros(shape, dtype=dtype, pin_memory=is_cuda)
        self.tensor: Tensor = self._host.cuda() if is_cuda else self._host
        self.host: np.ndarray = self._host.numpy()

    def send(self, rows: int | None = None) -> None:
        """Copy the first rows (all, if none is given) to the device.

        Does not wait: `host` must stay as it is until the device has been waited for.
        """
        if self.tensor is not self._host:
            self.tensor[:rows].copy_(self._host[:rows], non_blocking=True)

    def fetch(self, rows: int | None = None) -> np.ndarray:
        """The first rows as the device has them, when all its work is done; a view of `host`."""
        if self.tensor is not self._host:
            self._host[:rows].copy_(self.tensor[:rows])
        return self.host[:rows]
