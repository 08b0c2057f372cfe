"""Where a process computes with the scene model; apart from `choose_device`, so that it imports no torch."""

import os
from dataclasses import dataclass, field
from typing import Literal

DeviceKind = Literal["cpu", "cuda", "interpreter"]


@dataclass(frozen=True)
class Device:
    """One of three: numba on the CPU, Triton on an NVIDIA GPU, or Triton's interpreter for tests."""

    kind: DeviceKind
    name: str  # of the hardware
    reason: str  # why this one, in one line
    # that may compute at once
    threads: int = field(default_factory=lambda: len(os.sched_getaffinity(0)))

    @property
    def uses_triton(self) -> bool:
        """Whether the GPU's code path is taken: all but the CPU."""
        return self.kind != "cpu"

    @property
    def tensors_on(self) -> str:
        """Name of the torch device that tensors of the GPU's code path live on."""
        return "cuda" if self.kind == "cuda" else "cpu"

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


CPU = Device("cpu", "CPU", "the default of the library")
