"""The newest published map, as the tracker reads it on the CPU or on a GPU."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hsslam_node.device.device import Device
from hsslam_node.kernels.field.layout import KernelLayout, kernel_layout
from hsslam_node.map.parameters import FieldParameters

if TYPE_CHECKING:  # a CPU process imports neither torch nor Triton for this
    from torch import Tensor

    from hsslam_node.device.parameter_copy import PublishedCopy
    from hsslam_node.gpu_kernels.field.layout import GpuLayout


class TornMapError(Exception):
    """The map was overwritten while it was read, so the result mixes two versions."""


def _never_written() -> bool:
    return True


@dataclass(frozen=True)
class MapView:
    """One version of the map. `is_intact`: whether no later version has begun to overwrite its parameters."""

    version: int
    layout: KernelLayout
    params: np.ndarray  # [P] float32, used in place
    truncation_m: float
    on_device: "DeviceMap | None" = None  # copy on a GPU, which is queried instead
    is_intact: Callable[[], bool] = _never_written

    def expect_intact(self) -> None:
        """Raise TornMapError if a later version has begun to overwrite the parameters."""
        if not self.is_intact():
            raise TornMapError(f"version {self.version} of the map was overwritten")


@dataclass(frozen=True)
class DeviceMap:
    """Parameters on the device, and their layout."""

    device: Device
    layout: "GpuLayout"
    params: "Tensor"  # [P], or their geometry prefix


class MapViews:
    """Views of the versions of one map, also after it has grown; with a GPU they have a copy there.

    All views share one copy, so only the newest view is valid. If `with_color`, the copy holds all
    parameters, else those that signed distances need.
    """

    def __init__(
        self, parameters: FieldParameters, device: Device, *, with_color: bool = False
    ) -> None:
        self._parameters = parameters
        self._device = device
        self._with_color = with_color
        self._copy: PublishedCopy | None = None
        self._on_device: DeviceMap | None = None
        self._open()

    def newest(self) -> MapView | None:
        """The current version; None before the first."""
        while True:
            version, params = self._parameters.published()
            if version == 0:
                return None
            if self._field is not self._parameters.layout:
                self._open()
            if self._copy is not None:
                version = self._copy.pull()
            if self._field is self._parameters.layout:  # else the map grew during the pull
                break
        if self._view is None or self._view.version != version:
            truncation_m = self._parameters.layout.config.truncation_m
            is_intact = partial(self._parameters.is_intact, version)
            if self._on_device is not None:  # a pulled copy is never torn
                is_intact = _never_written
            self._view = MapView(
                version, self._layout, params, truncation_m, self._on_device, is_intact
            )
        return self._view

    def copied(self) -> MapView | None:
        """The current version with its own copy of the parameters (about 5 ms)."""
        while (view := self.newest()) is not None:
            own = replace(view, params=view.params.copy(), is_intact=_never_written)
            if view.is_intact():
                return own
        return None

    def _open(self) -> None:
        """Read the current layout, and open its copy on the device."""
        self._field = self._parameters.layout
        self._layout = kernel_layout(self._field)
        self._view: MapView | None = None
        if self._device.uses_triton:
            self._copy, self._on_device = _open_copy(
                self._parameters, self._device, self._with_color
            )


def _open_copy(
    parameters: FieldParameters, device: Device, with_color: bool
) -> "tuple[PublishedCopy, DeviceMap]":
    from hsslam_node.device.parameter_copy import PublishedCopy
    from hsslam_node.gpu_kernels.field.layout import gpu_layout

    layout = parameters.layout
    count = layout.parameter_count if with_color else layout.geometry_count
    copy = PublishedCopy(parameters, device, count)
    tables = gpu_layout(kernel_layout(layout), device.tensors_on)
    return copy, DeviceMap(device, tables, copy.params)
