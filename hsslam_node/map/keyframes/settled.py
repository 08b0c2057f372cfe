"""Rows of settled keyframes: those of old retired ones, which need no pose beside that of their anchor."""

import contextlib
from collections import deque
from typing import Final

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.map.keyframes.row_slabs import BLOCK_ROWS, SLAB_ROWS
from hsslam_node.map.keyframes.rows import KeyframeRows

_YOUNG: Final = 2 * SLAB_ROWS  # newest keyframes that never settle: 18 minutes of motion at 30 Hz
_REST: Final = 512  # keyframes until a block settles: nothing aligns to what was just retired
_DROP_AFTER: Final = 64  # keyframes until a settled block loses its memory: readers have finished
_MOST_BLOCKS: Final = 8  # in one correction


class Settling:
    """Chooses the blocks of rows that settle, and those that lose their memory.

    A process that corrects poses has one; only in a correction a block settles, and after it one loses its
    memory. What is chosen depends on the number of keyframes alone, so that runs in lockstep are the same.
    """

    def __init__(self, rows: KeyframeRows) -> None:
        self._rows = rows
        self._retired_at: dict[int, int] = {}  # keyframes there were when a block was first retired
        # keyframes there were when a block settled, and its number; None: not looked yet
        self._held: deque[tuple[int, int]] | None = None

    def settle(self, T_world_cam: np.ndarray, is_kept: np.ndarray, roots: np.ndarray) -> list[int]:
        """Write what blocks that settle need; returns their numbers, for `mark`.

        Args:
            T_world_cam: [n, 4, 4] of all keyframes, from now on.
            is_kept: [n] bool.
            roots: [n] int64, the kept keyframe that each moves with; -1: none.
        """
        count = len(is_kept)
        blocks = max(count - _YOUNG, 0) // BLOCK_ROWS
        can_settle = (~is_kept & (roots >= 0))[: blocks * BLOCK_ROWS].reshape(blocks, BLOCK_ROWS)
        is_settled = self._rows.settled_blocks(blocks)
        if self._held is None:
            self._held = deque((count, int(block)) for block in np.flatnonzero(is_settled))
            for _, block in self._held:  # a process may have died while it marked the rows of one
                self._rows.mark_settled(block)
        retired = np.flatnonzero(can_settle.all(1) & ~is_settled).tolist()
        self._retired_at = {block: self._retired_at.get(block, count) for block in retired}
        settled: list[int] = []
        for block in (block for block, at in self._retired_at.items() if count - at >= _REST):
            ids = np.arange(block * BLOCK_ROWS, (block + 1) * BLOCK_ROWS)
            with contextlib.suppress(OutOfMemoryError):  # later, once there is some
                self._rows.write_settled(ids, T_world_cam[ids], roots[ids], T_world_cam[roots[ids]])
                settled.append(block)
            if len(settled) == _MOST_BLOCKS:
                break
        return settled

    def mark(self, blocks: list[int], count: int) -> None:
        """Once the correction is the current one, so that readers see what was written: say that the blocks
        have settled."""
        assert self._held is not None
        for block in blocks:
            self._rows.mark_settled(block)
            self._held.append((count, block))

    def drop(self, count: int) -> None:
        """After a correction: return memory that settled blocks need no more."""
        for _ in range(_MOST_BLOCKS):
            if not self._held or count - self._held[0][0] < _DROP_AFTER:
                return
            self._rows.drop_block(self._held.popleft()[1])
