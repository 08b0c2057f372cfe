"""Pixels of keyframes, in places that are used again: slots in preallocated slabs."""

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.memory_order import load_ordered, store_ordered

SLAB_KEYFRAMES = 8  # 12 MB at 640x480: the system clears it while the tracker waits, in 7 ms
_REST = 8  # keyframes until a slot that was given up is written again, where others are free


class KeyframeSlots:
    """Which keyframe lies in which slot, and its pixels.

    An entry of the table is one number, so a process that dies leaves it as it was or as it is to be:
    k + 1, the slot has the pixels of keyframe k; 0, it was never used; -n, it was given up when there
    were n keyframes. The tracker takes slots, the mapper gives them up.
    """

    def __init__(self, arrays: ArrayAllocator, camera: Camera) -> None:
        self._arrays = arrays
        self._camera = camera
        self._table = arrays.open("keyframe_slots")  # [capacity] int64
        self._slabs: list[tuple[np.ndarray, np.ndarray]] = []

    @staticmethod
    def create_table(arrays: ArrayAllocator, capacity: int) -> None:
        """Make the table, or leave it as a former process of this run left it."""
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
        return np.sort(table[(table > 0) & (table <= count)]) - 1

    def holds(self, slot: int, k: int) -> bool:
        """Whether the slot has the pixels of keyframe k."""
        return load_ordered(self._table, slot) == k + 1

    def pixels(self, slot: int) -> tuple[np.ndarray, np.ndarray]:
        """Colour [H, W, 3] uint8 and raw depth [H, W] uint16 in a slot, not copied."""
        color, depth_raw = self._slab(slot // SLAB_KEYFRAMES, create=False)
        return color[slot % SLAB_KEYFRAMES], depth_raw[slot % SLAB_KEYFRAMES]

    def reserve(self, count: int, most: int) -> tuple[int, OutOfMemoryError | None]:
        """A slot below `most` for keyframe number `count`, -1 if there is none; and what memory said.

        First one that is free and has rested, then a new one, then one that was given up just now.
        """
        table = self._table[:most].copy()
        free = (table <= 0) | (
            table > count
        )  # those of a keyframe that was never complete are free
        reserved = np.arange(len(table)) < self._reserved_slots()
        rested = free & reserved & ((table >= 0) | (count + table >= _REST))
        if rested.any():
            return int(rested.argmax()), None
        fresh = free & ~reserved
        refusal = None
        if fresh.any():
            slot = int(fresh.argmax())
            try:
                self._slab(slot // SLAB_KEYFRAMES, create=True)
                return slot, None
            except OutOfMemoryError as error:
                refusal = error
        given_up = free & reserved
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

    def _reserved_slots(self) -> int:
        """Slots that have memory."""
        while self._arrays.exists(_names(len(self._slabs))[1]):
            self._slab(len(self._slabs), create=False)
        return SLAB_KEYFRAMES * len(self._slabs)

    def _slab(self, index: int, create: bool) -> tuple[np.ndarray, np.ndarray]:
        while len(self._slabs) <= index:
            color, depth = _names(len(self._slabs))
            size = (SLAB_KEYFRAMES, self._camera.height_px, self._camera.width_px)
            if create:
                slab = (
                    self._arrays.create(color, (*size, 3), np.uint8),
                    self._arrays.create(depth, size, np.uint16),
                )
            else:
                slab = self._arrays.open(color), self._arrays.open(depth)
            self._slabs.append(slab)
        return self._slabs[index]


def _names(slab: int) -> tuple[str, str]:
    return f"keyframe_color.{slab:03d}", f"keyframe_depth.{slab:03d}"
