"""The trained state of the scene model: parameters, Adam moments, and the map as published."""

import contextlib
from collections.abc import Iterator

import numpy as np

from hsslam_node.config import FieldConfig
from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.bound import Bound
from hsslam_node.kernels.compiled import njit
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.growth import copy_grown
from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.memory_order import load_ordered, store_ordered
from hsslam_node.map.parameter_arrays import PAGE, ParameterArrays

_STEP, _VERSION, _BEGUN, _READY, _GENERATION, _STEPPING = range(6)  # fields of the state


class FieldParameters:
    """Parameters with their optimiser over named arrays, and two slots to publish them in.

    Whoever steps, publishes or grows holds the writer's lease (the service's business). Readers never
    lock: they use the current slot in place and ask afterwards whether the writer has begun to
    overwrite it (`is_intact`); that takes two publications.

    A map that grows goes on in new arrays, its next *generation*. They are made whole before anybody
    is told, so a writer that dies meanwhile leaves the map as it was; versions and steps go on. All
    others attach to them by themselves (`follow`, `published`): `layout` and the arrays are then new
    objects. Arrays that are in use remain as they are.
    """

    def __init__(self, arrays: ArrayAllocator, config: FieldConfig) -> None:
        """Attach; KeyError if the parameters do not exist yet."""
        self._arrays = arrays
        self._config = config
        self._state = arrays.open("field_state")  # [16] int64
        if not load_ordered(self._state, _READY):
            raise KeyError("field_state")
        self._attach()

    @classmethod
    def create(cls, arrays: ArrayAllocator, layout: FieldLayout, seed: int) -> "FieldParameters":
        """Create and initialise the arrays, or attach to those of this run."""
        state = arrays.create("field_state", (16,), np.int64)
        if not load_ordered(state, _READY):
            ParameterArrays.create(arrays, layout, 0).params[:] = initial_parameters(layout, seed)
            state[_STEP] = state[_GENERATION] = 0
            store_ordered(state, _READY, 1)
        return cls(arrays, layout.config)

    @property
    def layout(self) -> FieldLayout:
        """Where everything lies; another object once the map has grown."""
        return self._current.layout

    @property
    def params(self) -> np.ndarray:
        """Parameters [P] float32."""
        return self._current.params

    @property
    def first_moment(self) -> np.ndarray:
        """Adam's first moment [P]."""
        return self._current.first_moment

    @property
    def second_moment(self) -> np.ndarray:
        """Adam's second moment [P]."""
        return self._current.second_moment

    @property
    def stepped_at(self) -> np.ndarray:
        """Adam step that last moved each chunk [P / 16] int32; copies ask it what they lack."""
        return self._current.stepped_at

    @property
    def page_stepped_at(self) -> np.ndarray:
        """The same for pages of 64 chunks: a reader looks at pages first."""
        return self._current.page_stepped_at

    @property
    def version(self) -> int:
        """Published version; 0 before the first publication."""
        return load_ordered(self._state, _VERSION)

    @property
    def step(self) -> int:
        """Adam steps so far, by anybody."""
        return load_ordered(self._state, _STEP)

    def gradient_arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Writer: values [P] and marks of the gradient, which all writers share: zeros between steps.

        Raises:
            OutOfMemoryError: there is no room for them.
        """
        return ParameterArrays.gradient(self._arrays, self.layout, self._generation)

    @contextlib.contextmanager
    def stepping(self, *gradient: np.ndarray) -> Iterator[None]:
        """Writer: around a step, which leaves `gradient` as zeros; first clears what a dead one has left."""
        if load_ordered(self._state, _STEPPING):
            for array in gradient:
                array[:] = 0
        store_ordered(self._state, _STEPPING, 1)
        yield
        store_ordered(self._state, _STEPPING, 0)

    def count_step(self) -> int:
        """Writer: the number of the next Adam step, from 1."""
        step = self.step + 1
        store_ordered(self._state, _STEP, step)
        return step

    def mark_stepped(self, chunks: np.ndarray, steps: np.ndarray | int) -> None:
        """Writer: say by which step `chunks` [n] were moved, where not the Adam kernel moved them."""
        self.stepped_at[chunks] = steps
        np.maximum.at(self.page_stepped_at, chunks // PAGE, steps)

    def publish(self) -> int:
        """Writer: bring the free slot up to date and make it current; returns the new version."""
        version = self.version + 1
        store_ordered(self._state, _BEGUN, version)
        self._bring_up_to_date(version % 2)
        store_ordered(self._state, _VERSION, version)
        if version == 1:  # the first copy is of everything: for the other slot, before frames come
            self._bring_up_to_date(0)
        return version

    def published(self) -> tuple[int, np.ndarray]:
        """Reader: version and parameters [P] in place; check `is_intact(version)` after use.

        They lie as `layout` says after this call: the map may have grown.
        """
        while True:
            version = self.version
            if not self.follow():  # asked after the version: a growth comes before its publication
                return version, self._current.slots[version % 2]

    def published_step(self, version: int) -> int:
        """Reader: the Adam step after which `version` was published; as `published`, check it."""
        return int(self._current.slot_step[version % 2])

    def is_intact(self, version: int) -> bool:
        """Reader: whether the slot of `version` has not been written to since it was current."""
        return load_ordered(self._state, _BEGUN) < version + 2

    def follow(self) -> bool:
        """Attach to the newest generation; whether that was another one."""
        if load_ordered(self._state, _GENERATION) == self._generation:
            return False
        self._attach()
        return True

    def grow(self, bound: Bound, seed: int) -> None:
        """Writer: let the map reach over `bound` as well; what it says where it was does not change.

        The caller publishes afterwards. What is new is initialised as a new map is.

        Raises:
            OutOfMemoryError: there is no room for the larger map; it stays as it was.
        """
        self.follow()
        old, generation = self._current, self._generation + 1
        layout = old.layout.grown(bound)
        for left_by_the_dead in (generation, generation - 2):
            if left_by_the_dead >= 0:
                ParameterArrays.remove(self._arrays, left_by_the_dead)
        try:
            new = ParameterArrays.create(self._arrays, layout, generation)
        except OutOfMemoryError:
            ParameterArrays.remove(self._arrays, generation)
            raise
        new.params[:] = initial_parameters(layout, (seed, generation))
        copy_grown(old.layout, old.params, layout, new.params)
        copy_grown(old.layout, old.first_moment, layout, new.first_moment)
        copy_grown(old.layout, old.second_moment, layout, new.second_moment)
        new.slots[:] = new.params
        new.slot_step[:] = self.step
        store_ordered(self._state, _GENERATION, generation)
        self._attach()
        ParameterArrays.remove(self._arrays, generation - 1)

    def _attach(self) -> None:
        while True:
            generation = load_ordered(self._state, _GENERATION)
            try:
                self._current = ParameterArrays.open(self._arrays, self._config, generation)
            except KeyError:
                if generation == load_ordered(self._state, _GENERATION):
                    raise
                continue  # replaced meanwhile
            self._generation = generation
            return

    def _bring_up_to_date(self, slot: int) -> None:
        now = self._current
        since = now.slot_step[slot]
        _copy_stepped(now.params, now.slots[slot], now.stepped_at, now.page_stepped_at, since)
        now.slot_step[slot] = self.step


@njit(cache=True, nogil=True, error_model="numpy")
def _copy_stepped(params, slot, stepped_at, page_stepped_at, since):
    for page in range(page_stepped_at.shape[0]):
        if page_stepped_at[page] > since:
            for chunk in range(page * PAGE, min((page + 1) * PAGE, stepped_at.shape[0])):
                if stepped_at[chunk] > since:
                    for k in range(16 * chunk, 16 * chunk + 16):
                        slot[k] = params[k]
