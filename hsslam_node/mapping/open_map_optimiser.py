"""The optimiser of the scene model: one interface for CPU and GPU."""

from typing import Protocol

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.device.device import Device
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.map_optimiser import MapOptimiser, Poses, StepReport
from hsslam_node.mapping.ray_need import RayNeed


class Optimiser(Protocol):
    """Steps the parameters of a map under the writer's lease; see `MapOptimiser`, its CPU twin.

    A GPU steps a copy. Each step first fetches what other processes have stepped. `push` sends the changes
    to host memory; call it before you publish the map or release the lease.

    `reports_late`: whether the first look at a report waits for the device. Look at it after the next step
    has drawn its rays, and host and device work at the same time.
    """

    reports_late: bool

    def step(
        self,
        store: KeyframeStore,
        keyframes: np.ndarray,
        counts: np.ndarray,
        poses: Poses,
        generator: np.random.Generator,
        *,
        rate_factor: float = 1.0,
        with_poses: bool = False,
        update: bool = True,
        need: RayNeed | None = None,
    ) -> StepReport: ...

    def push(self) -> None: ...


def open_map_optimiser(
    config: SlamConfig, parameters: FieldParameters, rays: int, device: Device
) -> Optimiser:
    """An optimiser for batches of up to `rays` rays on the device."""
    if device.uses_triton:
        from hsslam_node.mapping.gpu.map_optimiser import GpuMapOptimiser

        return GpuMapOptimiser(config, parameters, rays, device)
    return MapOptimiser(config, parameters, rays, device.threads)
