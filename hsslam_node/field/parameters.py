"""The trained state of the scene model: parameters, Adam moments, and the map as published."""

import numpy as np
from numba import njit

from hsslam_node.config import FieldConfig
from hsslam_node.field.initialisation import initial_parameters
from hsslam_node.field.layout import FieldLayout
from hsslam_node.geometry.bound import Bound
from hsslam_node.keyframes.allocator import ArrayAllocator

_STEP, _VERSION, _BEGUN, _READY, _SLOT_STEP = 0, 1, 2, 3, 4  # fields of the state; the last twice
_PAGE = 64  # chunks of 16 floats


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
        # [P / 16] int32: the Adam step that last moved each chunk; copies ask it what they lack
        self.stepped_at = arrays.open("params_stepped_at")
        # [~P / 1024] int32: the same for pages of 64 chunks, so that nobody needs to ask all chunks
        self.page_stepped_at = arrays.open("params_page_stepped_at")
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
            arrays.create("params_stepped_at", (P // 16,), np.int32)[:] = 0
            pages = -(-P // (16 * _PAGE))
            arrays.create("params_page_stepped_at", (pages,), np.int32)[:] = 0
            arrays.create("published", (2, P), np.float32)
            bound = arrays.create("field_bound", (2, 3), np.float64)
            bound[:] = layout.bound.low, layout.bound.high
            params[:] = initial_parameters(layout, seed)
            state[_STEP] = 0
            state[_SLOT_STEP : _SLOT_STEP + 2] = -1  # nothing is in the slots
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

    def mark_stepped(self, chunks: np.ndarray, steps: np.ndarray | int) -> None:
        """Writer: say by which step `chunks` [n] were moved, where not the Adam kernel moved them."""
        self.stepped_at[chunks] = steps
        np.maximum.at(self.page_stepped_at, chunks // _PAGE, steps)

    def publish(self) -> int:
        """Writer: bring the free slot up to date and make it current; returns the new version."""
        version = self.version + 1
        self._state[_BEGUN] = version
        self._bring_up_to_date(version % 2)
        self._state[_VERSION] = version
        if version == 1:  # the first copy is of everything: for the other slot, before frames come
            self._bring_up_to_date(0)
        return version

    def published(self) -> tuple[int, np.ndarray]:
        """Reader: version and parameters [P] in place; check `is_intact(version)` after use."""
        version = self.version
        return version, self._slots[version % 2]

    def published_step(self, version: int) -> int:
        """Reader: the Adam step after which `version` was published; as `published`, check it."""
        return int(self._state[_SLOT_STEP + version % 2])

    def is_intact(self, version: int) -> bool:
        """Reader: whether the slot of `version` has not been written to since it was current."""
        return int(self._state[_BEGUN]) < version + 2

    def _bring_up_to_date(self, slot: int) -> None:
        since = self._state[_SLOT_STEP + slot]
        _copy_stepped(self.params, self._slots[slot], self.stepped_at, self.page_stepped_at, since)
        self._state[_SLOT_STEP + slot] = self.step


@njit(cache=True, nogil=True, error_model="numpy")
def _copy_stepped(params, slot, stepped_at, page_stepped_at, since):
    for page in range(page_stepped_at.shape[0]):
        if page_stepped_at[page] > since:
            for chunk in range(page * _PAGE, min((page + 1) * _PAGE, stepped_at.shape[0])):
                if stepped_at[chunk] > since:
                    for k in range(16 * chunk, 16 * chunk + 16):
                        slot[k] = params[k]
