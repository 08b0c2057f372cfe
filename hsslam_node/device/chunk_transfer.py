"""Chunks of 16 floats between arrays in host memory and their copies on the device."""

import numpy as np
import torch
from torch import Tensor

from hsslam_node.device.device import Device

CHUNK = 16


class ChunkTransfer:
    """Moves chosen chunks either way, through page-locked memory where the device is CUDA.

    Arrays are flat, float32, of a multiple of 16 floats; device arrays were made for `device`.
    """

    def __init__(self, device: Device) -> None:
        self._is_cuda = device.kind == "cuda"
        self._staging = torch.empty(0, CHUNK)

    def upload(self, source: np.ndarray, chunks: np.ndarray, target: Tensor) -> None:
        """target[chunks] = source[chunks]; chunks [n] int64, ascending. Returns when it is done."""
        rows = self._rows(len(chunks))
        np.take(source.reshape(-1, CHUNK), chunks, axis=0, out=rows.numpy())
        places = torch.from_numpy(chunks).to(target.device)
        target.view(-1, CHUNK).index_copy_(0, places, rows.to(target.device, non_blocking=True))
        self._wait()

    def download(self, source: Tensor, chunks: Tensor, target: np.ndarray) -> None:
        """target[chunks] = source[chunks]; chunks [n] int64 on the device. Returns when it is done."""
        rows = self._rows(len(chunks))
        rows.copy_(source.view(-1, CHUNK).index_select(0, chunks), non_blocking=True)
        self._wait()
        target.reshape(-1, CHUNK)[chunks.cpu().numpy()] = rows.numpy()

    def _rows(self, count: int) -> Tensor:
        if len(self._staging) < count:
            self._staging = torch.empty(count, CHUNK, pin_memory=self._is_cuda)
        return self._staging[:count]

    def _wait(self) -> None:
        """Until the staging memory is free again."""
        if self._is_cuda:
            torch.cuda.synchronize()
