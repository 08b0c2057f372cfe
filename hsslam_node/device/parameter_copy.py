"""Copies of the parameters on the device, transferred in chunks of 16 floats.

`ParameterCopy` is for a process that steps them, `PublishedCopy` for processes that only read the map.
"""

import numpy as np
import torch
from torch import Tensor

from hsslam_node.device.device import Device
from hsslam_node.map.parameters import FieldParameters

CHUNK = 16


class ChunkTransfer:
    """Copies chosen chunks from host to device and back, on CUDA through page-locked memory.

    Arrays are flat, float32, of a multiple of 16 floats; device arrays are on `device`.
    """

    def __init__(self, device: Device) -> None:
        self._is_cuda = device.kind == "cuda"
        self._staging = torch.empty(0, CHUNK)

    def upload(self, source: np.ndarray, chunks: np.ndarray, target: Tensor) -> None:
        """target[chunks] = source[chunks]; chunks [n] int64, ascending. Returns when done."""
        rows = self._rows(len(chunks))
        np.take(source.reshape(-1, CHUNK), chunks, axis=0, out=rows.numpy())
        places = torch.from_numpy(chunks).to(target.device)
        target.view(-1, CHUNK).index_copy_(0, places, rows.to(target.device, non_blocking=True))
        self._wait()

    def download(self, source: Tensor, chunks: Tensor, target: np.ndarray) -> None:
        """target[chunks] = source[chunks]; chunks [n] int64 on the device. Returns when done."""
        rows = self._rows(len(chunks))
        rows.copy_(source.view(-1, CHUNK).index_select(0, chunks), non_blocking=True)
        self._wait()
        target.reshape(-1, CHUNK)[chunks.cpu().numpy()] = rows.numpy()

    def _rows(self, count: int) -> Tensor:
        if len(self._staging) < count:
            self._staging = torch.empty(count, CHUNK, pin_memory=self._is_cuda)
        return self._staging[:count]

    def _wait(self) -> None:
        """Wait until the staging memory is free."""
        if self._is_cuda:
            torch.cuda.synchronize()


class ParameterCopy:
    """Copy of `FieldParameters` for a process that steps them: pulls and pushes the chunks that changed.

    The process holds the writer's lease while it steps, pulls before its first step, and pushes before it
    releases the lease or publishes the map.
    """

    def __init__(self, parameters: FieldParameters, device: Device) -> None:
        P = len(parameters.params)
        on = device.tensors_on
        self._host = parameters
        self._transfer = ChunkTransfer(device)
        self._step = -1  # of the host's parameters in the copy
        self.params = torch.empty(P, device=on)
        self.first_moment = torch.empty(P, device=on)
        self.second_moment = torch.empty(P, device=on)
        # [P / 16] the step that last moved each chunk here; 0 if the host has it
        self.stepped_at = torch.zeros(P // CHUNK, dtype=torch.int32, device=on)

    def pull(self) -> None:
        """Fetch the chunks that other processes have stepped, if any."""
        host = self._host
        if host.step == self._step:
            return
        chunks = np.flatnonzero(host.stepped_at > self._step)
        for source, target in self._pairs():
            self._transfer.upload(source, chunks, target)
        self._step = host.step

    def count_step(self) -> int:
        """Count the next step on the host and return its number; the copy then counts as up to date."""
        self._step = self._host.count_step()
        return self._step

    def push(self) -> None:
        """Send the chunks that were stepped here to the host."""
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


class PublishedCopy:
    """Copy of the first `count` parameters of the newest published version, for a process that reads."""

    def __init__(self, parameters: FieldParameters, device: Device, count: int) -> None:
        self._host = parameters
        self._layout = parameters.layout
        self._transfer = ChunkTransfer(device)
        self._step = -1
        self.version = 0  # of the map in the copy; 0: none yet
        self.params = torch.empty(count, device=device.tensors_on)  # [count]

    def pull(self) -> int:
        """Update the copy to the newest version and return the version. Never waits for a writer.

        If the map has grown, `parameters.layout` changes and this copy stays as it is: open another.
        """
        host, count = self._host, len(self.params)
        while host.version != self.version:
            version, published = host.published()
            if host.layout is not self._layout:
                break
            step = host.published_step(version)
            # includes chunks that writers mark meanwhile, with the values of the published slot
            chunks = np.flatnonzero(host.stepped_at[: count // 16] > self._step)
            self._transfer.upload(published[:count], chunks, self.params)
            if host.is_intact(version):
                self.version, self._step = version, step
        return self.version
