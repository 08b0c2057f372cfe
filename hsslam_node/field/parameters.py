"""The trained state of the scene model: parameters, Adam moments, and the map as published."""

import numpy as np
from numba import njit

from hsslam_node.config import FieldConfig
from hsslam_node.field.initialisation import initial_parameters
from hsslam_node.field.layout import FieldLayout
from hsslam_node.geometry.bound import Bound
from hsslam_node.keyframes.allocator import ArrayAllocator

_STEP, _VERSION, _BEGUN, _READY = 0, 1, 2, 3  # fields of the state


class FieldParameters:
    """Parameters with their optimiser over named arrays, and two slots to publish them in.

    Whoever steps or publishes holds the writer's lease (the service's business). Readers never
    lock: they use the current slot in place and ask afterwards whether the writer has begun to
    overwrite it (`is_intact`); that takes two publications.
    """

    def __init__(self, arrays: ArrayAllocator, config: FieldConfig) -> None:
        """Attach; KeyError where nobody has created the parameters yet."""
        self._state = arrays.open("field_state")  # [16] int64
        if not self._state[_READY]:
            raise KeyError("field_state")
        low, high = arrays.open("field_bound")  # [2, 3] float64 m
        self.layout = FieldLayout(config, Bound.of(low, high))
        self.params = arrays.open("params")  # [P] float32
        self.first_moment = arrays.open("adam_first")  # [P]
        self.second_moment = arrays.open("adam_second")  # [P]
        self.stale = arrays.open("params_stale")  # [P / 16] uint8, bit s: slot s lacks the chunk
        self._slots = arrays.open("published")  # [2, P]

    @classmethod
    def create(cls, arrays: ArrayAllocator, layout: FieldLayout, seed: int) -> "FieldParameters":
        """Create and initialise the arrays, or attach to those of this run."""
        state = arrays.create("field_state", (16,), np.int64)
        P = layout.parameter_count
        if not state[_READY]:
            params = arrays.create("params", (P,), np.float32)
            arrays.create("adam_first", (P,), np.float32)[:] = 0
            arrays.create("adam_second", (P,), np.float32)[:] = 0
            arrays.create("params_stale", (P // 16,), np.uint8)[:] = 3
            arrays.create("published", (2, P), np.float32)
            bound = arrays.create("field_bound", (2, 3), np.float64)
            bound[:] = layout.bound.low, layout.bound.high
            params[:] = initial_parameters(layout, seed)
            state[_STEP] = 0
            state[_READY] = 1
        return cls(arrays, layout.config)

    @property
    def version(self) -> int:
        """Published version; 0 before the first publication."""
        return int(self._state[_VERSION])

    @property
    def step(self) -> int:
        """Adam steps so far, by anybody."""
        return int(self._state[_STEP])

    def count_step(self) -> int:
        """Writer: the number of the next Adam step, from 1."""
        self._state[_STEP] += 1
        return int(self._state[_STEP])

    def publish(self) -> int:
        """Writer: bring the free slot up to date and make it current; returns the new version."""
        version = self.version + 1
        self._state[_BEGUN] = version
        _copy_stale(self.params, self._slots[version % 2], self.stale, 1 << (version % 2))
        self._state[_VERSION] = version
        return version

    def published(self) -> tuple[int, np.ndarray]:
        """Reader: version and parameters [P] in place; check `is_intact(version)` after use."""
        version = self.version
        return version, self._slots[version % 2]

    def is_intact(self, version: int) -> bool:
        """Reader: whether the slot of `version` has not been written to since it was current."""
        return int(self._state[_BEGUN]) < version + 2


@njit(cache=True, nogil=True, error_model="numpy")
def _copy_stale(params, slot, stale, bit):
    for chunk in range(stale.shape[0]):
        if stale[chunk] & bit:
            for k in range(16 * chunk, 16 * chunk + 16):
                slot[k] = params[k]
            stale[chunk] &= ~bit
