"""Tracking and mapping of a few tiny frames, so that no real frame waits for machine code to load."""

import dataclasses
import os
import time
from collections.abc import Iterator
from functools import cache

import numpy as np

from hsslam_node.config import FieldConfig, SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.slam import Slam

_WIDTH_PX, _HEIGHT_PX, _UNITS_PER_M = 160, 120, 1000.0
_COARSER, _HASH_TABLE_LOG2 = 4, 12


@dataclasses.dataclass(frozen=True)
class WarmStart:
    """The process that has loaded the kernels, and how long it took."""

    pid: int
    took_s: float

    @property
    def is_inherited(self) -> bool:
        """Whether a parent loaded them, before it forked this process."""
        return self.pid != os.getpid()


@cache
def warm_start(config: SlamConfig, device: Device = CPU) -> WarmStart:
    """Track and map three frames of a textured wall, then forget them. The field is that of `config`, and on
    the CPU coarser, as its kernels serve fields of all sizes.

    Runs once for each configuration and device. A forked process inherits kernels and result of its
    parent: the fork server runs this for all its forks.
    """
    start_s = time.monotonic()
    small = dataclasses.replace(
        config,
        field=config.field if device.uses_triton else _coarse(config.field),
        keyframes=dataclasses.replace(config.keyframes, every_frames=1, capacity=8),
        mapper=dataclasses.replace(config.mapper, rays=64, first_iterations=1, iterations=1),
        rendering_tracker=dataclasses.replace(config.rendering_tracker, pixels=64, iterations=1),
        ba=dataclasses.replace(config.ba, enabled=False),
    )
    # the fork server may have no more threads
    slam = Slam(small, device=dataclasses.replace(device, threads=1))
    for frame in textured_wall(3):
        slam.process(frame)
    return WarmStart(os.getpid(), time.monotonic() - start_s)


def _coarse(field: FieldConfig) -> FieldConfig:
    """Fewer cells, which take less time to initialise."""
    return dataclasses.replace(
        field,
        coarse_cell_m=_COARSER * field.coarse_cell_m,
        geometry_fine_cell_m=_COARSER * field.geometry_fine_cell_m,
        appearance_fine_cell_m=_COARSER * field.appearance_fine_cell_m,
        hash_table_log2=min(field.hash_table_log2, _HASH_TABLE_LOG2),
    )


def textured_wall(count: int) -> Iterator[Frame]:
    """Frames of a wall 2 m away, from a camera that stands still."""
    camera = Camera(_WIDTH_PX, _HEIGHT_PX, 130.0, 130.0, 79.5, 59.5)
    texture = np.random.default_rng(0).integers(0, 255, (_HEIGHT_PX // 8, _WIDTH_PX // 8, 3))
    color = np.kron(texture, np.ones((8, 8, 1))).astype(np.uint8)
    depth = np.full((_HEIGHT_PX, _WIDTH_PX), 2000, np.uint16)
    for index in range(count):
        yield Frame(index, index * 33_000_000, camera, color, depth, _UNITS_PER_M)
