"""The device that a process computes on; apart from `choose_device`, so that it imports no torch."""

import os
from dataclasses import dataclass, field
from typing import Literal

DeviceKind = Literal["cpu", "cuda", "interpreter"]


@dataclass(frozen=True)
class Device:
    """Numba on the CPU, Triton on an NVIDIA GPU, or Triton's interpreter for tests."""

    kind: DeviceKind
    name: str  # of the hardware
    reason: str  # why this one, in one line
    # that may compute in parallel
    threads: int = field(default_factory=lambda: len(os.sched_getaffinity(0)))

    @property
    def uses_triton(self) -> bool:
        """Whether the device runs the code for GPUs: all but the CPU do."""
        return self.kind != "cpu"

    @property
    def tensors_on(self) -> str:
        """Name of the torch device for the tensors of the code for GPUs."""
        return "cuda" if self.kind == "cuda" else "cpu"

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


CPU = Device("cpu", "CPU", "the default of the library")
