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
from hsslam_node.tracking.keyframes.reference_keyframe import stored_reference

_WIDTH_PX, _HEIGHT_PX, _UNITS_PER_M = 160, 120, 1000.0
_NOISE_MM = 8.0
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
    if small.tracker.reference_views:
        assert slam.store is not None
        stored_reference(slam.store, slam.store.count - 1, small.tracker)
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
    """Frames of a wall 2 m away, with noisy depth, from a camera that stands still."""
    camera = Camera(_WIDTH_PX, _HEIGHT_PX, 130.0, 130.0, 79.5, 59.5)
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 255, (_HEIGHT_PX // 8, _WIDTH_PX // 8, 3))
    color = np.kron(texture, np.ones((8, 8, 1))).astype(np.uint8)
    for index in range(count):
        depth = np.rint(rng.normal(2000.0, _NOISE_MM, (_HEIGHT_PX, _WIDTH_PX))).astype(np.uint16)
        yield Frame(index, index * 33_000_000, camera, color, depth, _UNITS_PER_M)
