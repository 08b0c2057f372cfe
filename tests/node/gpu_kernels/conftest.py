"""Fields of all kinds on the device, with the float64 reference; importing this sets up Triton."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from torch import Tensor

from hsslam_node.config import FieldConfig
from tests.node.gpu_kernels.interpreter import DEVICE, import_gpu_kernels
from tests.node.kernels.conftest import Field, close, field_of  # noqa: F401

import_gpu_kernels()

from hsslam_node.gpu_kernels.field.layout import GpuLayout, gpu_layout  # noqa: E402

_GROWN = FieldConfig(plane_channels=16, hash_table_log2=13)
_KINDS = {
    "16 channels": FieldConfig(plane_channels=16, hash_table_log2=13),
    "32 channels": FieldConfig(plane_channels=32, hash_table_log2=13),
    "hash grid and one-blob": FieldConfig(plane_channels=0, hash_table_log2=13, hash_levels=20),
    "planes only": FieldConfig(plane_channels=16, hash_levels=0, oneblob_bins=0),
    "grown": _GROWN,
}


@dataclass(frozen=True)
class GpuField:
    """A field of the CPU kernels' tests, and the same on the device."""

    cpu: Field
    layout: GpuLayout
    params: Tensor  # [P] float32


@pytest.fixture(scope="session", params=_KINDS.values(), ids=_KINDS.keys())
def gpu_field(request) -> GpuField:
    cpu = field_of(request.param, grown=request.param is _GROWN)
    return GpuField(cpu, gpu_layout(cpu.kernel, DEVICE), on_device(cpu.params))


def on_device(array: np.ndarray) -> Tensor:
    """A copy of the array on the device, its type kept."""
    return torch.from_numpy(np.array(array)).to(DEVICE)


def empty(*shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """A tensor on the device full of 7: what a kernel must overwrite."""
    return torch.full(shape, 7, dtype=dtype, device=DEVICE)
