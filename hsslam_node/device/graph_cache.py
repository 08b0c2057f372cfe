"""CUDA graphs of work that is done again and again with the same shapes."""

from collections import Counter
from collections.abc import Callable, Hashable

import torch

from hsslam_node.device.device import Device

_PLAIN_RUNS = 3  # of a shape before it is captured: kernels are compiled, tables are tuned
_MOST_GRAPHS = 16


class GraphCache:
    """Runs work; on CUDA a shape that keeps coming up is captured once and then replayed.

    The work only launches kernels on tensors that stay where they are: inputs are written into them
    before, results are read from them after `run`. It neither reads from the device nor waits for it.
    As PyTorch's notes on CUDA graphs ask, warm-up and capture are made on one side stream, which waits
    for the caller's stream and is waited for.

    The gain has not been measured: this was written without a GPU at hand. Other devices launch plainly.
    """

    def __init__(self, device: Device) -> None:
        self._is_cuda = device.kind == "cuda"
        self._stream = torch.cuda.Stream() if self._is_cuda else None
        self._runs: Counter[Hashable] = Counter()
        self._graphs: dict[Hashable, torch.cuda.CUDAGraph] = {}

    def run(self, shape: Hashable, work: Callable[[], None]) -> None:
        """Do `work`, which launches the same kernels with the same arguments for equal `shape`."""
        if self._stream is None:
            work()
            return
        self._runs[shape] += 1
        if shape not in self._graphs and self._is_worth_it(shape):
            self._graphs[shape] = self._captured(work)
        if shape in self._graphs:
            self._graphs[shape].replay()
            return
        self._stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self._stream):
            work()
        torch.cuda.current_stream().wait_stream(self._stream)

    def _is_worth_it(self, shape: Hashable) -> bool:
        return self._runs[shape] > _PLAIN_RUNS and len(self._graphs) < _MOST_GRAPHS

    def _captured(self, work: Callable[[], None]) -> torch.cuda.CUDAGraph:
        """The graph of the work, which capturing does not execute."""
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, stream=self._stream):
            work()
        return graph
