"""Copies of the parameters on the device, transferred in chunks of 16 floats.

`ParameterCopy` is for a process that steps them, `PublishedCopy` for processes that only read the map.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from hsslam_node.device.chunk_copies import CHUNK, gather_chunks, scatter_chunks
from hsslam_node.device.device import Device
from hsslam_node.map.parameters import FieldParameters

_MOST_CHUNKS = 1 << 16  # of a part, 4 MB of each array


class ChunkTransfer:
    """Copies chosen chunks from host to device and back, on CUDA through page-locked memory.

    Arrays are flat, float32, of a multiple of 16 floats; device arrays are on `device`. Many chunks go in
    parts, so that little memory is page-locked.
    """

    def __init__(self, device: Device) -> None:
        self._is_cuda = device.kind == "cuda"
        self._staging = torch.empty(0)

    def upload(
        self, sources: Sequence[np.ndarray], chunks: np.ndarray, targets: Sequence[Tensor]
    ) -> None:
        """target[chunks] = source[chunks] of each pair; chunks [n] int64, ascending. Returns when done."""
        for first in range(0, len(chunks), _MOST_CHUNKS):
            part = chunks[first : first + _MOST_CHUNKS]
            staging = self._rows(len(sources), len(part))
            places = torch.from_numpy(part).to(targets[0].device)
            for source, rows, target in zip(sources, staging, targets, strict=True):
                gather_chunks(source, part, rows.numpy())
                sent = rows.to(target.device, non_blocking=True)
                target.view(-1, CHUNK).index_copy_(0, places, sent)
            self._wait()

    def download(
        self, sources: Sequence[Tensor], chunks: Tensor, targets: Sequence[np.ndarray]
    ) -> None:
        """target[chunks] = source[chunks] of each pair; chunks [n] int64 on the device. Returns when done."""
        for part in chunks.split(_MOST_CHUNKS):
            staging = self._rows(len(sources), len(part))
            for source, rows in zip(sources, staging, strict=True):
                rows.copy_(source.view(-1, CHUNK).index_select(0, part), non_blocking=True)
            places = part.cpu().numpy()
            self._wait()
            for rows, target in zip(staging, targets, strict=True):
                scatter_chunks(rows.numpy(), places, target)

    def _rows(self, arrays: int, count: int) -> Tensor:
        """Staging memory [arrays, count, 16]; made for `_MOST_CHUNKS` at once, as page-locking takes time."""
        floats = arrays * count * CHUNK
        if len(self._staging) < floats:
            room = arrays * CHUNK * (_MOST_CHUNKS if self._is_cuda else count)
            self._staging = torch.empty(room, pin_memory=self._is_cuda)
        return self._staging[:floats].view(arrays, count, CHUNK)

    def _wait(self) -> None:
        """Wait until the staging memory is free."""
        if self._is_cuda:
            torch.cuda.current_stream().synchronize()


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
        self._transfer.upload(self._on_host(), chunks, self._on_device())
        self._step = host.step

    def count_step(self) -> int:
        """Count the next step on the host and return its number; the copy then counts as up to date."""
        self._step = self._host.count_step()
        return self._step

    def push(self) -> None:
        """Send the chunks that were stepped here to the host."""
        chunks = torch.nonzero(self.stepped_at).flatten()
        self._transfer.download(self._on_device(), chunks, self._on_host())
        on_host = chunks.cpu().numpy()
        self._host.mark_stepped(on_host, self.stepped_at[chunks].cpu().numpy())
        self.stepped_at.zero_()

    def _on_host(self) -> tuple[np.ndarray, ...]:
        return self._host.params, self._host.first_moment, self._host.second_moment

    def _on_device(self) -> tuple[Tensor, ...]:
        return self.params, self.first_moment, self.second_moment


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
            chunks = np.flatnonzero(host.stepped_at[: count // CHUNK] > self._step)
            self._transfer.upload([published[:count]], chunks, [self.params])
            if host.is_intact(version):
                self.version, self._step = version, step
        return self.version
