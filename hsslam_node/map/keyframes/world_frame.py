"""Gravity in the world, and the transform from the world to the robot's level frame."""

import numpy as np

from hsslam_node.inertial.gravity import Gravity
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.keyframes.header import GRAVITY
from hsslam_node.map.memory_order import load_ordered, store_ordered

LEVEL = 7  # where the level frame begins in the array `keyframe_camera`


class WorldFrame:
    """Gravity and the level frame of a store, shared by all processes.

    Args:
        header: [16] int64, see `header.py`.
        gravity: [2, 4] float64, up and its sigma; two banks.
        level: [16] float64, rows of a [4, 4]; zeros: not known.
    """

    def __init__(self, header: np.ndarray, gravity: np.ndarray, level: np.ndarray) -> None:
        self._header = header
        self._gravity = gravity
        self._level = level

    @property
    def gravity(self) -> Gravity | None:
        """Gravity in the world, by an IMU; None: not known."""
        while True:
            version = load_ordered(self._header, GRAVITY)
            if version == 0:
                return None
            x, y, z, sigma_rad = self._gravity[version % 2].tolist()
            if load_ordered(self._header, GRAVITY) == version:
                return Gravity((x, y, z), sigma_rad)

    def note_gravity(self, gravity: Gravity) -> None:
        """Set gravity; only the tracker, and the creator of the store of a saved map, do this."""
        version = load_ordered(self._header, GRAVITY) + 1
        self._gravity[version % 2] = *gravity.up, gravity.sigma_rad
        store_ordered(self._header, GRAVITY, version)

    @property
    def T_level_world(self) -> np.ndarray | None:
        """[4, 4] to the frame `map` of the robot that began the world (`level_frame`); None: not known."""
        return self._level.reshape(4, 4).copy() if self._level.any() else None

    def note_level(self, T_level_world: np.ndarray | None) -> None:
        """Set `T_level_world`, before other processes use the store; the first value stays."""
        if T_level_world is not None and not self._level.any():
            self._level[:] = T_level_world.ravel()


def level_frame_in(arrays: ArrayAllocator) -> np.ndarray | None:
    """`T_level_world` of the store among the arrays, for a process that reads no keyframes; None: there is no
    store yet, or it is not known."""
    try:
        rows = arrays.open("keyframe_camera")[LEVEL:]
    except KeyError:
        return None
    return rows.reshape(4, 4).copy() if rows.any() else None
