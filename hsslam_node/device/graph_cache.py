"""CUDA graphs of work that repeats with the same shapes."""

from collections import Counter
from collections.abc import Callable, Hashable

import torch

from hsslam_node.device.device import Device

_PLAIN_RUNS = 3  # of a shape before its capture, which compile and tune kernels
_MOST_GRAPHS = 16


class GraphCache:
    """Runs work; on CUDA it captures a shape that repeats as a graph, once, and then replays the graph.

    The work only launches kernels, on tensors at fixed addresses; it neither reads from the device nor waits
    for it. The caller writes inputs before `run` and reads results after it.
    Warm-up and capture run on one side stream, as PyTorch's notes on CUDA graphs ask. The side stream and
    the caller's stream wait for each other.

    Other devices run the work without graphs.
    """

    def __init__(self, device: Device) -> None:
        self._is_cuda = device.kind == "cuda"
        self._stream = torch.cuda.Stream() if self._is_cuda else None
        self._runs: Counter[Hashable] = Counter()
        self._graphs: dict[Hashable, torch.cuda.CUDAGraph] = {}

    def run(self, shape: Hashable, work: Callable[[], None]) -> None:
        """Run `work`, which launches the same kernels with the same arguments for an equal `shape`."""
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
        """The graph of the work; capturing does not execute it."""
        graph = torch.cuda.CUDAGraph()
        # another thread of the program may use CUDA meanwhile
        with torch.cuda.graph(graph, stream=self._stream, capture_error_mode="thread_local"):
            work()
        return graph
