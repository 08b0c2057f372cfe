"""How many keyframes may be kept, and who waits for room: numbers that the tracker and the mapper share."""

import numpy as np

from hsslam_node.map.keyframes.header import COUNT, MOST, REFUSED, WANTED
from hsslam_node.map.keyframes.slots import KeyframeSlots
from hsslam_node.map.memory_order import load_ordered, store_ordered


class KeyframeRoom:
    """Room for keyframes with pixels; `header` [16] int64, see `header.py`."""

    def __init__(self, header: np.ndarray, slots: KeyframeSlots) -> None:
        self._header = header
        self._slots = slots

    @property
    def capacity(self) -> int:
        """Most keyframes that can be kept at a time."""
        return len(self._slots)

    @property
    def most_kept(self) -> int:
        """Most keyframes that may be kept at a time, as memory permits now."""
        return load_ordered(self._header, MOST) or self.capacity

    def allow(self, most_kept: int) -> None:
        """The mapper only: keep at most this many keyframes from now on."""
        store_ordered(self._header, MOST, min(max(most_kept, 1), self.capacity))

    @property
    def refused(self) -> int:
        """How often there was no room for a keyframe that was due."""
        return load_ordered(self._header, REFUSED)

    def refuse(self) -> None:
        """The tracker only: count a keyframe that was due and had no room."""
        store_ordered(self._header, REFUSED, self.refused + 1)

    @property
    def free(self) -> int:
        """Keyframes that can come now; what is staged is not counted."""
        return self.most_kept - len(self._slots.held(load_ordered(self._header, COUNT)))

    @property
    def wanted(self) -> int:
        """Keyframes that wait for room, 0: none."""
        return load_ordered(self._header, WANTED)

    def want(self, keyframes: int) -> None:
        """The tracker only: note how many keyframes wait for room, 0: none."""
        store_ordered(self._header, WANTED, keyframes)

    def is_short(self) -> bool:
        """Whether keyframes wait for more room than there is: then the mapper retires others."""
        return self.wanted > 0 and self.wanted > self.free
