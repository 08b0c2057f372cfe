"""Pixels of keyframes, in reusable slots of preallocated slabs."""

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.memory_order import load_ordered, store_ordered

SLAB_KEYFRAMES = 8  # at most
_SLAB_BYTES = 12.5e6  # of a slab of two or more; the tracker waits 7 ms while the system clears it
_REST = 8  # keyframes until a slot that was given up is reused, if others are free
_READY = 8  # rested slots that keep their memory, so that the next keyframe need not wait
_MOST_DROPPED = 2  # slots that lose their memory with one keyframe, 0.5 ms each at 640x480
_DROPPED = -np.iinfo(np.int64).max  # entry of a slot without memory


class KeyframeSlots:
    """The table of slots, and the pixels in them.

    An entry of the table is one number, so a process that dies leaves no entry half written:
    k + 1: the slot has the pixels of keyframe k; 0: it was never used; -n: it was given up when there
    were n keyframes, and has its memory; `_DROPPED`: it was given up and has no memory. The mapper gives
    slots up; the tracker takes slots, and drops the memory of rested ones.
    """

    def __init__(self, arrays: ArrayAllocator, camera: Camera) -> None:
        self._arrays = arrays
        self._camera = camera
        self._per_slab = min(max(int(_SLAB_BYTES) // self.slot_bytes, 1), SLAB_KEYFRAMES)
        self._table = arrays.open("keyframe_slots")  # [capacity] int64
        self._slabs: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # threads may open one at once
        self._reserved_slabs = 0  # that are known to exist

    @staticmethod
    def create_table(arrays: ArrayAllocator, capacity: int) -> None:
        """Create the table, or keep that of a former process of this run."""
        arrays.create("keyframe_slots", (capacity,), np.int64)

    def __len__(self) -> int:
        return len(self._table)

    @property
    def slot_bytes(self) -> int:
        """Memory of the pixels of one keyframe."""
        return 5 * self._camera.width_px * self._camera.height_px

    def held(self, count: int) -> np.ndarray:
        """Ids of the keyframes below `count` that have their pixels, sorted [m] int64."""
        table = self._table.copy()  # other processes write it meanwhile
        return np.sort(table[_is_held(table, count)]) - 1

    def holds(self, slot: int, k: int) -> bool:
        """Whether the slot has the pixels of keyframe k."""
        return load_ordered(self._table, slot) == k + 1

    def pixels(self, slot: int) -> tuple[np.ndarray, np.ndarray]:
        """Colour [H, W, 3] uint8 and raw depth [H, W] uint16 in a slot, not copied."""
        slab, row = divmod(slot, self._per_slab)
        color, depth_raw = self._slab(slab, create=False)
        return color[row], depth_raw[row]

    def reserve(self, count: int, most: int) -> tuple[int, OutOfMemoryError | None]:
        """A slot for keyframe `count`, -1: `most` are held or memory is out; and the error of memory, if any.

        It is a rested slot with memory, else one that gets memory, if fewer than `most` have memory, else
        the one that was given up longest ago.
        """
        table = self._table.copy()
        free = ~_is_held(table, count)
        if np.count_nonzero(~free) >= most:
            return -1, None
        has_memory = self._has_memory(table)
        rested = free & has_memory & ((table >= 0) | (count + table >= _REST))
        if rested.any():
            return int(rested.argmax()), None
        refusal = None
        without = np.flatnonzero(~has_memory)
        if len(without) and np.count_nonzero(has_memory) < most:
            slot = int(without[0])
            try:
                self._get_memory(slot)
                return slot, None
            except OutOfMemoryError as error:
                refusal = error
        given_up = free & has_memory
        if given_up.any():
            longest_ago = np.where(given_up, table, -np.iinfo(np.int64).max)
            return int(longest_ago.argmax()), refusal
        return -1, refusal

    def write(self, slot: int, color: np.ndarray, depth_raw: np.ndarray) -> None:
        """Fill a slot that no process reads."""
        to_color, to_depth = self.pixels(slot)
        to_color[:] = color
        to_depth[:] = depth_raw

    def take(self, slot: int, k: int) -> None:
        """The slot has the pixels of keyframe k from now on."""
        store_ordered(self._table, slot, k + 1)

    def give_up(self, slot: int, count: int) -> None:
        """The slot may be used again; `count`: keyframes now, 1 or more."""
        store_ordered(self._table, slot, -count)

    def free(self, slot: int) -> None:
        """The tracker only: free a slot of a keyframe that no process has seen."""
        store_ordered(self._table, slot, 0)

    def forget_incomplete(self, count: int) -> None:
        """The tracker only: free the slots of incomplete keyframes; `count` are complete."""
        for slot in np.flatnonzero(self._table > count).tolist():
            self.free(slot)

    def drop(self, count: int, most: int) -> None:
        """The tracker only: return the memory of rested slots to the system.

        Some keep it for the next keyframes, while no more than `most` slots have memory.
        """
        table = self._table.copy()
        has_memory = self._has_memory(table)
        rested = np.flatnonzero(has_memory & (table < 0) & (count + table >= _REST))
        ready = min(_READY, max(most - np.count_nonzero(has_memory) + len(rested), 0))
        for slot in rested[ready:][:_MOST_DROPPED].tolist():
            # first the mark: if the tracker dies in between, memory is wasted, but the table stays true
            store_ordered(self._table, slot, _DROPPED)
            slab, row = divmod(slot, self._per_slab)
            for name in _names(slab):
                self._arrays.drop_row(name, row)

    def _has_memory(self, table: np.ndarray) -> np.ndarray:
        return (np.arange(len(table)) < self._reserved_slots()) & (table != _DROPPED)

    def _get_memory(self, slot: int) -> None:
        """Memory for a slot that has none.

        Raises:
            OutOfMemoryError: there is not enough.
        """
        slab, row = divmod(slot, self._per_slab)
        if slot >= self._reserved_slots():
            self._slab(slab, create=True)
            return
        for name in _names(slab):
            self._arrays.reserve_row(name, row)

    def _reserved_slots(self) -> int:
        """Number of slots in the slabs that exist."""
        while self._arrays.exists(_names(self._reserved_slabs)[1]):
            self._reserved_slabs += 1
        return self._per_slab * self._reserved_slabs

    def _slab(self, index: int, create: bool) -> tuple[np.ndarray, np.ndarray]:
        slab = self._slabs.get(index)
        if slab is None:
            color, depth = _names(index)
            size = (self._per_slab, self._camera.height_px, self._camera.width_px)
            if create:
                slab = (
                    self._arrays.create(color, (*size, 3), np.uint8),
                    self._arrays.create(depth, size, np.uint16),
                )
            else:
                slab = self._arrays.open(color), self._arrays.open(depth)
            self._slabs[index] = slab
        return slab


def _is_held(table: np.ndarray, count: int) -> np.ndarray:
    """[slots] bool; a slot of a keyframe that was never complete is free."""
    return (table > 0) & (table <= count)


def _names(slab: int) -> tuple[str, str]:
    return f"keyframe_color.{slab:03d}", f"keyframe_depth.{slab:03d}"
