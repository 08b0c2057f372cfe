"""The device's copy of the published map, for processes that only ask it."""

import numpy as np
import torch

from hsslam_node.device.chunk_transfer import ChunkTransfer
from hsslam_node.device.device import Device
from hsslam_node.map.parameters import FieldParameters


class PublishedCopy:
    """The first `count` parameters of the newest version that was published, chunk by chunk."""

    def __init__(self, parameters: FieldParameters, device: Device, count: int) -> None:
        self._host = parameters
        self._layout = parameters.layout
        self._transfer = ChunkTransfer(device)
        self._step = -1
        self.version = 0  # of the map in the copy; 0: none yet
        self.params = torch.empty(count, device=device.tensors_on)  # [count]

    def pull(self) -> int:
        """Bring the copy to the newest version; returns it. Never waits for a writer.

        A map that has grown needs another copy: this one stays as it is, and `parameters.layout` tells.
        """
        host, count = self._host, len(self.params)
        while host.version != self.version:
            version, published = host.published()
            if host.layout is not self._layout:
                break
            step = host.published_step(version)
            # writers go on marking chunks meanwhile: those are taken too, as the slot has them
            chunks = np.flatnonzero(host.stepped_at[: count // 16] > self._step)
            self._transfer.upload(published[:count], chunks, self.params)
            if host.is_intact(version):
                self.version, self._step = version, step
        return self.version
