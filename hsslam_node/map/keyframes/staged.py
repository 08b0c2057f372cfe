"""Keyframes whose pixels lie in a store before any process sees them; pixels take 7 ms each, rows do not."""

from collections.abc import Callable
from dataclasses import dataclass

from hsslam_node.frame import Frame
from hsslam_node.map.keyframes.rows import KeyframeRows
from hsslam_node.map.keyframes.slots import KeyframeSlots


@dataclass(frozen=True)
class StagedKeyframe:
    """What was measured, and the slot of its pixels."""

    frame_index: int
    stamp_ns: int
    slot: int


class StagedKeyframes:
    """Pixels of the keyframes that come next, written a few at a time by the tracker.

    While there are some, no other keyframe may be appended. `KeyframeStore.append_staged` shows them all at
    once; `give_up` frees their slots. If the tracker dies, its successor frees them (`forget_incomplete`).
    """

    def __init__(
        self, slots: KeyframeSlots, rows: KeyframeRows, first: int, most: Callable[[], int]
    ) -> None:
        """`first`: id of the first of them; `most`: keyframes that may be kept at a time, as of now."""
        self._slots = slots
        self._rows = rows
        self._first = first
        self._most = most
        self.staged: list[StagedKeyframe] = []

    def add(self, frame: Frame) -> bool:
        """Write the pixels of one more; whether there was room."""
        k = self._first + len(self.staged)
        slot, _ = self._slots.reserve(k, self._most())
        if slot < 0 or not self._rows.reserve(k):
            return False
        self._slots.write(slot, frame.color, frame.depth_raw)
        self._slots.take(slot, k)
        self.staged.append(StagedKeyframe(frame.index, frame.stamp_ns, slot))
        return True

    def give_up(self) -> None:
        """None of them comes."""
        for keyframe in self.staged:
            self._slots.free(keyframe.slot)
        self.staged.clear()
