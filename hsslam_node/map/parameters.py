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
    """Parameters and Adam moments in named arrays, and two slots to publish them in.

    A process that steps, publishes or grows the map holds the lease, which the service manages. Readers
    do not lock: they use the current slot in place, then check that the writer has not begun to
    overwrite it (`is_intact`). The writer overwrites the slot of a version two publications later.

    A map that grows moves to new arrays, its next *generation*. The writer completes them before it
    announces them, so if it dies meanwhile, the map stays as it was. Versions and steps continue. Other
    processes attach in `follow` and `published`: `layout` and the arrays are then new objects. Old
    arrays stay valid while a process uses them.
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
        """The layout of the arrays; another object after the map has grown."""
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
        """Adam step that last moved each chunk [P / 16] int32; copies use it to find changes."""
        return self._current.stepped_at

    @property
    def page_stepped_at(self) -> np.ndarray:
        """The same for pages of 64 chunks, which a reader checks first."""
        return self._current.page_stepped_at

    @property
    def version(self) -> int:
        """Published version; 0 before the first publication."""
        return load_ordered(self._state, _VERSION)

    @property
    def step(self) -> int:
        """Adam steps so far, by all processes."""
        return load_ordered(self._state, _STEP)

    def gradient_arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Writer: values [P] and marks of the gradient; all writers share them, zero between steps.

        Raises:
            OutOfMemoryError: there is no room for them.
        """
        return ParameterArrays.gradient(self._arrays, self.layout, self._generation)

    @contextlib.contextmanager
    def stepping(self, *gradient: np.ndarray) -> Iterator[None]:
        """Writer: around a step, which leaves `gradient` zero; clears it first if a writer died in a step."""
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

    def resume_steps(self, step: int) -> None:
        """Writer: the next Adam step is the one after `step`, as in the map that was saved."""
        store_ordered(self._state, _STEP, step)

    def mark_stepped(self, chunks: np.ndarray, steps: np.ndarray | int) -> None:
        """Writer: note which step moved `chunks` [n], if it was not the Adam kernel."""
        self.stepped_at[chunks] = steps
        np.maximum.at(self.page_stepped_at, chunks // PAGE, steps)

    def publish(self) -> int:
        """Writer: bring the free slot up to date and make it current; returns the new version."""
        version = self.version + 1
        store_ordered(self._state, _BEGUN, version)
        self._bring_up_to_date(version % 2)
        store_ordered(self._state, _VERSION, version)
        if version == 1:  # copy everything to the other slot now, before frames come
            self._bring_up_to_date(0)
        return version

    def published(self) -> tuple[int, np.ndarray]:
        """Reader: version and parameters [P] in place; check `is_intact(version)` after use.

        `layout` after this call is their layout: the map may have grown.
        """
        while True:
            version = self.version
            if not self.follow():  # after the version is read: the map grows before it publishes
                return version, self._current.slots[version % 2]

    def published_step(self, version: int) -> int:
        """Reader: the Adam step after which `version` was published; check `is_intact` after use."""
        return int(self._current.slot_step[version % 2])

    def is_intact(self, version: int) -> bool:
        """Reader: whether no writer has begun to overwrite the slot of `version`."""
        return load_ordered(self._state, _BEGUN) < version + 2

    def follow(self) -> bool:
        """Attach to the newest generation; returns whether it is another one."""
        if load_ordered(self._state, _GENERATION) == self._generation:
            return False
        self._attach()
        return True

    def grow(self, bound: Bound, seed: int) -> None:
        """Writer: extend the map over `bound`; it does not change within the old bound.

        The caller publishes afterwards. New parts are initialised like a new map.

        Raises:
            OutOfMemoryError: there is no room for the larger map; it stays as it was.
        """
        self.follow()
        old, generation = self._current, self._generation + 1
        layout = old.layout.grown(bound)
        for stale in (generation, generation - 2):
            if stale >= 0:
                ParameterArrays.remove(self._arrays, stale)
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
