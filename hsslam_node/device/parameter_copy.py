"""The device's copy of the parameters and their moments, for a process that steps them."""

import numpy as np
import torch

from hsslam_node.device.chunk_transfer import CHUNK, ChunkTransfer
from hsslam_node.device.device import Device
from hsslam_node.map.parameters import FieldParameters


class ParameterCopy:
    """Follows `FieldParameters` in host memory, chunk by chunk, and brings back what was stepped.

    Whoever steps holds the writer's lease, pulls before the first step, and pushes before the lease
    is given back or the map is published.
    """

    def __init__(self, parameters: FieldParameters, device: Device) -> None:
        P = len(parameters.params)
        on = device.tensors_on
        self._host = parameters
        self._transfer = ChunkTransfer(device)
        self._step = -1  # of the host's parameters that are in the copy
        self.params = torch.empty(P, device=on)
        self.first_moment = torch.empty(P, device=on)
        self.second_moment = torch.empty(P, device=on)
        # [P / 16] the step that last moved each chunk here; 0 where the host has it
        self.stepped_at = torch.zeros(P // CHUNK, dtype=torch.int32, device=on)

    def pull(self) -> None:
        """Take over what others have stepped; nothing to do where nobody has."""
        host = self._host
        if host.step == self._step:
            return
        chunks = np.flatnonzero(host.stepped_at > self._step)
        for source, target in self._pairs():
            self._transfer.upload(source, chunks, target)
        self._step = host.step

    def count_step(self) -> int:
        """The number of the next step, counted for all; the copy is what it starts from."""
        self._step = self._host.count_step()
        return self._step

    def push(self) -> None:
        """Bring what was stepped here to the host."""
        chunks = torch.nonzero(self.stepped_at).flatten()
        for target, source in self._pairs():
            self._transfer.download(source, chunks, target)
        on_host = chunks.cpu().numpy()
        self._host.mark_stepped(on_host, self.stepped_at[chunks].cpu().numpy())
        self.stepped_at.zero_()

    def _pairs(self) -> list[tuple[np.ndarray, torch.Tensor]]:
        host = self._host
        return [
            (host.params, self.params),
            (host.first_moment, self.first_moment),
            (host.second_moment, self.second_moment),
        ]
