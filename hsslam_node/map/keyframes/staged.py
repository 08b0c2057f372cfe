"""Staged keyframes: their pixels, 7 ms each, are in the store before any process sees the keyframes."""

from collections.abc import Callable
from dataclasses import dataclass

from hsslam_node.frame import Frame
from hsslam_node.map.keyframes.rows import KeyframeRows
from hsslam_node.map.keyframes.slots import KeyframeSlots


@dataclass(frozen=True)
class StagedKeyframe:
    """Frame index, stamp, and the slot of the pixels."""

    frame_index: int
    stamp_ns: int
    slot: int


class StagedKeyframes:
    """Pixels of the next keyframes, which the tracker writes a few at a time.

    While keyframes are staged, no other may be appended. `KeyframeStore.append_staged` shows all at once;
    `give_up` frees their slots. If the tracker dies, its successor frees them (`forget_incomplete`).
    """

    def __init__(
        self, slots: KeyframeSlots, rows: KeyframeRows, first: int, most: Callable[[], int]
    ) -> None:
        """`first`: id of the first staged keyframe; `most`: returns how many may be kept at a time now."""
        self._slots = slots
        self._rows = rows
        self._first = first
        self._most = most
        self.staged: list[StagedKeyframe] = []

    def add(self, frame: Frame) -> bool:
        """Write the pixels of one more keyframe; False if there is no room."""
        k = self._first + len(self.staged)
        slot, _ = self._slots.reserve(k, self._most())
        if slot < 0 or not self._rows.reserve(k, has_gap=True):
            return False
        self._slots.write(slot, frame.color, frame.depth_raw)
        self._slots.take(slot, k)
        self.staged.append(StagedKeyframe(frame.index, frame.stamp_ns, slot))
        return True

    def give_up(self) -> None:
        """Free the slots of all staged keyframes."""
        for keyframe in self.staged:
            self._slots.free(keyframe.slot)
        self.staged.clear()
