"""Poses of keyframes, in two banks: readers copy them without a lock, one process at a time corrects them."""

import contextlib
import time
from collections.abc import Iterator

import numpy as np

from hsslam_node.map.keyframes.header import APPENDING, COUNT, POSE_VERSION
from hsslam_node.map.keyframes.rows import KeyframeRows
from hsslam_node.map.keyframes.settled import Settling
from hsslam_node.map.keyframes.slots import KeyframeSlots
from hsslam_node.map.memory_order import load_ordered, store_ordered
from hsslam_node.map.pose_correction import (
    PoseCorrection,
    carry_retired,
    follow_references,
    on_top,
    roots,
)

_POLL_S = 0.0005
_LONGEST_APPEND_S = 2.0  # a tracker that appends longer has died; it may wait for a core


class KeyframePoses:
    """A correction writes the bank that is not current, then bumps the version, which makes it current.

    Args:
        header: [16] int64, see `header.py`.
        rows: they hold the banks.
        slots: they know which keyframes are kept.
    """

    def __init__(self, header: np.ndarray, rows: KeyframeRows, slots: KeyframeSlots) -> None:
        self._header = header
        self._rows = rows
        self._slots = slots
        self._settling = Settling(rows)

    @property
    def version(self) -> int:
        """Grows with every correction."""
        return load_ordered(self._header, POSE_VERSION)

    def all(self) -> np.ndarray:
        """T_world_cam of all keyframes, [n, 4, 4], a consistent copy."""
        while True:
            version = self.version
            copy = self._rows.all_poses(self._count, version % 2)
            if self.version == version:
                return copy

    def of(self, ids: np.ndarray) -> np.ndarray:
        """T_world_cam of keyframes `ids` [m] int64, [m, 4, 4], a consistent copy."""
        while True:
            version = self.version
            copy = self._rows.poses(ids, version % 2)
            if self.version == version:
                return copy

    def one(self, k: int) -> tuple[np.ndarray, int]:
        """T_world_cam of keyframe k, [4, 4], and its version."""
        while True:
            version = self.version
            copy = self._rows.pose(k, version % 2)
            if self.version == version:
                return copy, version

    @contextlib.contextmanager
    def appending(self) -> Iterator[None]:
        """As `KeyframeStore.appending`."""
        store_ordered(self._header, APPENDING, self._count + 1)
        try:
            yield
        finally:
            store_ordered(self._header, APPENDING, 0)

    def correct(
        self,
        ids: np.ndarray,
        T_world_cam: np.ndarray,
        known: int | None,
        T_then: np.ndarray | None = None,
    ) -> PoseCorrection:
        """As `KeyframeStore.correct_poses`."""
        version, n = self.version, self._count
        before = self._rows.all_poses(n, version % 2)
        after = before.copy()
        after[ids] = T_world_cam if T_then is None else on_top(T_then, before[ids], T_world_cam)
        is_kept = np.isin(np.arange(n), self._slots.held(n))
        anchors = self._rows.anchors(n)
        is_kept |= anchors >= n  # retired just now, for a keyframe that came after these n
        root = roots(is_kept, anchors)
        carry_retired(before, after, root)
        if known is not None and known < n:
            follow_references(before, after, np.arange(known, n), self._rows.references(n))
            carry_retired(before, after, root)  # those that hang on one of these
        moved = np.flatnonzero((after != before).any(axis=(1, 2)))
        self._rows.write_bank(after, (version + 1) % 2)
        settled = self._settling.settle(after, is_kept, root)
        store_ordered(self._header, POSE_VERSION, version + 1)
        self._settling.mark(settled, n)
        self._settling.drop(n)
        correction = PoseCorrection(version + 1, moved, after[moved])
        return correction if known is None else self._with_late(correction, n)

    @property
    def _count(self) -> int:
        return load_ordered(self._header, COUNT)

    def _with_late(self, correction: PoseCorrection, n: int) -> PoseCorrection:
        """Also move the keyframes that were appended at old poses while the bank was written."""
        self._wait_for_append()
        late = np.arange(n, self._count)
        late = late[self._rows.versions(n, n + len(late)) < correction.version]
        if len(late) == 0:
            return correction
        banks = (correction.version + 1) % 2, correction.version % 2
        before, after = (self._rows.all_poses(int(late[-1]) + 1, bank) for bank in banks)
        follow_references(before, after, late, self._rows.references(len(after)))
        late = late[(after[late] != before[late]).any(axis=(1, 2))]
        if len(late) == 0:
            return correction
        return correction.with_more(self.correct(late, after[late], None))

    def _wait_for_append(self) -> None:
        """Wait until the keyframe that is being appended now, perhaps at an old pose, is counted."""
        deadline_s = time.monotonic() + _LONGEST_APPEND_S
        while (number := load_ordered(self._header, APPENDING)) > self._count:
            if time.monotonic() > deadline_s:
                store_ordered(self._header, APPENDING, 0)  # its tracker has died
                return
            time.sleep(_POLL_S)
            if load_ordered(self._header, APPENDING) != number:
                return
