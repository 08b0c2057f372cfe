"""Rows of keyframes, kept for ever: stamp, pose, slot of the pixels, anchor."""

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.se3_batch import inverse_batch
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.keyframes.row_slabs import BLOCK_ROWS, COLUMNS, SLAB_ROWS, RowSlabs

# columns; the loss is a float64
_FRAME_INDEX, _STAMP_NS, _SLOT, _ANCHOR, _VERSION, _FRAGMENT, _REFERENCE, _LOSS, _DUE, _FLAGS = (
    range(COLUMNS)
)
_GAP, _SETTLED = 1, 2  # flags
_LEAST_LOSS = np.finfo(np.float64).tiny  # 0 stands for an unknown loss


class KeyframeRows:
    """Append-only rows in slabs, so that their number has no limit: 752 bytes each, and 290 more in a slab
    with motions by odometry alone.

    A *settled* row has the pose relative to its anchor alone: 128 bytes. Its covariance is that of its
    anchor, and nothing may ask for what the mapper noted of it. Rows settle in blocks of `BLOCK_ROWS`.

    Poses lie in two banks that readers copy without a lock. The owner of the rows knows how many are
    complete, and which bank is current.
    """

    def __init__(self, arrays: ArrayAllocator) -> None:
        self._slabs = RowSlabs(arrays)

    def write(
        self,
        k: int,
        frame_index: int,
        stamp_ns: int,
        slot: int,
        version: int,
        T: np.ndarray,
        covariance: np.ndarray,
        gap_covariance: np.ndarray,
        fragment: int = 0,
        reference: int = -1,
    ) -> None:
        """Write row k before any process reads it; T_world_cam [4, 4] is of pose version `version`.

        covariance: [6, 6] of the pose, as in `geometry/pose_covariance.py`.
        gap_covariance: [6, 6] as in `KeyframeStore.append`. fragment, reference: see `fragments` and
            `references`.

        Raises:
            OutOfMemoryError: there is no room for another slab of rows.
        """
        slab = self._slabs.slab(k // SLAB_ROWS, create=True)
        row = k % SLAB_ROWS
        slab.meta[row, :7] = frame_index, stamp_ns, slot, -1, version, fragment, reference
        slab.poses[:, row] = T
        slab.covariances[row] = covariance
        has_gap = bool(np.any(gap_covariance))
        slab.meta[row, _FLAGS] = _GAP * has_gap
        if has_gap:
            self._slabs.gaps(k // SLAB_ROWS, create=True)[row] = gap_covariance

    def reserve(self, k: int, has_gap: bool) -> bool:
        """The tracker only: make room for row k, with or without a gap; False if there is no memory."""
        try:
            self._slabs.slab(k // SLAB_ROWS, create=True)
            if has_gap:
                self._slabs.gaps(k // SLAB_ROWS, create=True)
        except OutOfMemoryError:
            return False
        return True

    def frame_indices(self, count: int) -> np.ndarray:
        """Frame index of the first `count` keyframes, [count] int64."""
        return self._column(_FRAME_INDEX, count)

    def stamps_ns(self, count: int) -> np.ndarray:
        """Sensor stamps of the first `count` keyframes, [count] int64 ns."""
        return self._column(_STAMP_NS, count)

    def fragments(self, count: int) -> np.ndarray:
        """The fragment in which the camera was tracked to each of the first `count` keyframes, [count] int64;
        0: the map."""
        return self._column(_FRAGMENT, count)

    def anchors(self, count: int) -> np.ndarray:
        """The anchor of each of the first `count` keyframes, [count] int64; -1: none."""
        return self._column(_ANCHOR, count)

    def references(self, count: int) -> np.ndarray:
        """The earlier keyframe from which the pose of each of the first `count` keyframes was taken, [count]
        int64; -1: none."""
        return self._column(_REFERENCE, count)

    def versions(self, first: int, count: int) -> np.ndarray:
        """Pose versions at which the poses of keyframes `first` to `count` were taken, [n] int64."""
        return np.array([self._meta(k)[_VERSION] for k in range(first, count)], np.int64)

    def identity(self, k: int) -> tuple[int, int]:
        """Frame index and stamp (ns) of keyframe k."""
        row = self._meta(k)
        return int(row[_FRAME_INDEX]), int(row[_STAMP_NS])

    def slot(self, k: int) -> int:
        """Slot of the pixels of keyframe k when it was appended."""
        return int(self._meta(k)[_SLOT])

    def hang(self, k: int, anchor: int) -> None:
        """Set the anchor of keyframe k, with which it moves once it has no pixels."""
        self._meta(k)[_ANCHOR] = anchor

    def note_losses(self, ids: np.ndarray, losses: np.ndarray) -> None:
        """Set the newest losses [n] of keyframes `ids` [n]; one writer at a time."""
        for slab, mine, rows in self._slabs.of(ids):
            slab.meta.view(np.float64)[rows, _LOSS] = np.maximum(losses[mine], _LEAST_LOSS)

    def losses(self, ids: np.ndarray) -> np.ndarray:
        """The newest losses of keyframes `ids` [n], [n] float64; nan: not known."""
        noted = np.empty(len(ids))
        for slab, mine, rows in self._slabs.of(ids):
            noted[mine] = slab.meta.view(np.float64)[rows, _LOSS]
        return np.where(noted > 0, noted, np.nan)

    def note_mapped(self, ids: np.ndarray, T_world_cam: np.ndarray, due: np.ndarray) -> None:
        """The mapper only: see `KeyframeStore.note_mapped`."""
        for slab, mine, rows in self._slabs.of(ids):
            slab.meta[rows, _DUE] = due[mine]
            slab.mapped[rows] = T_world_cam[mine]

    def mapped(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What `note_mapped` noted of keyframes `ids` [n]: T_world_cam [n, 4, 4] and due [n] int64."""
        T_world_cam, due = np.empty((len(ids), 4, 4)), np.empty(len(ids), np.int64)
        for slab, mine, rows in self._slabs.of(ids):
            T_world_cam[mine], due[mine] = slab.mapped[rows], slab.meta[rows, _DUE]
        return T_world_cam, due

    def covariance(self, k: int) -> np.ndarray:
        """[6, 6] of the pose that keyframe k was appended with, copied."""
        while self._meta(k)[_FLAGS] & _SETTLED:
            k = int(self._meta(k)[_ANCHOR])
        return self._slabs.slab(k // SLAB_ROWS).covariances[k % SLAB_ROWS].copy()

    def gap_covariance(self, k: int) -> np.ndarray:
        """[6, 6] of the gap before keyframe k, as in `KeyframeStore.append`, copied."""
        if not self._meta(k)[_FLAGS] & _GAP:
            return np.zeros((6, 6))
        return self._slabs.gaps(k // SLAB_ROWS)[k % SLAB_ROWS].copy()

    def pose(self, k: int, bank: int) -> np.ndarray:
        """T_world_cam [4, 4] of keyframe k, copied."""
        if self._meta(k)[_FLAGS] & _SETTLED:
            return self.poses(np.array([k]), bank)[0]
        return self._slabs.slab(k // SLAB_ROWS).poses[bank, k % SLAB_ROWS].copy()

    def poses(self, ids: np.ndarray, bank: int) -> np.ndarray:
        """T_world_cam [n, 4, 4] of keyframes `ids` [n], copied."""
        # poses, which of them are settled, the places of their anchors in the next, T_anchor_keyframe
        followers = []
        while True:
            out, is_settled = np.empty((len(ids), 4, 4)), self._are_settled(ids)
            live = np.flatnonzero(~is_settled)
            for slab, mine, rows in self._slabs.of(ids[live]):
                out[live[mine]] = slab.poses[bank, rows]
            if len(live) == len(ids):
                break
            T_anchor_keyframe, anchors = self._to_anchors(ids[is_settled])
            ids, places = np.unique(anchors, return_inverse=True)  # these may be settled, too
            followers.append((out, is_settled, places, T_anchor_keyframe))
        for following, is_settled, places, T_anchor_keyframe in reversed(followers):
            following[is_settled] = out[places] @ T_anchor_keyframe
            out = following
        return out

    def all_poses(self, count: int, bank: int) -> np.ndarray:
        """T_world_cam [count, 4, 4] of the first `count` keyframes, copied."""
        out, is_settled = np.empty((count, 4, 4)), self._column(_FLAGS, count) & _SETTLED > 0
        for s in range(-(-count // SLAB_ROWS)):
            part = out[s * SLAB_ROWS : (s + 1) * SLAB_ROWS]
            live = _live(is_settled, s)
            part[live] = self._slabs.slab(s).poses[bank, : len(part)][live]
        if is_settled.any():
            out[is_settled] = self.poses(np.flatnonzero(is_settled), bank)
        return out

    def write_bank(self, poses: np.ndarray, bank: int) -> None:
        """Overwrite the poses of the first keyframes in the bank that no process reads, [n, 4, 4]."""
        is_settled = self._column(_FLAGS, len(poses)) & _SETTLED > 0
        for s in range(-(-len(poses) // SLAB_ROWS)):
            part = poses[s * SLAB_ROWS : (s + 1) * SLAB_ROWS]
            live = _live(is_settled, s)
            self._slabs.slab(s).poses[bank, : len(part)][live] = part[live]

    def settled_blocks(self, blocks: int) -> np.ndarray:
        """Which of the first blocks are settled, [blocks] bool."""
        return self._column(_FLAGS, blocks * BLOCK_ROWS)[::BLOCK_ROWS] & _SETTLED > 0

    def write_settled(
        self, ids: np.ndarray, T_world_cam: np.ndarray, anchors: np.ndarray, T_anchors: np.ndarray
    ) -> None:
        """Write what retired keyframes `ids` [n] of one block need once it is settled: their anchors [n] from
        now on, which are kept, and T_world_cam [n, 4, 4] of both.

        Raises:
            OutOfMemoryError: there is no memory for it; nothing has changed.
        """
        slab, rows = int(ids[0]) // SLAB_ROWS, ids % SLAB_ROWS
        T_anchor_keyframe = inverse_batch(T_anchors) @ T_world_cam
        self._slabs.relative(slab, create=True)[rows] = T_anchor_keyframe[:, :3]
        self._slabs.slab(slab).meta[rows, _ANCHOR] = anchors

    def mark_settled(self, block: int) -> None:
        """From now on the keyframes of a block have the poses that `write_settled` wrote."""
        ids = np.arange(block * BLOCK_ROWS, (block + 1) * BLOCK_ROWS)
        self._slabs.slab(int(ids[0]) // SLAB_ROWS).meta[ids % SLAB_ROWS, _FLAGS] |= _SETTLED

    def drop_block(self, block: int) -> None:
        """Return the memory of a settled block, which no process reads, to the system."""
        self._slabs.drop_block(block)

    def _to_anchors(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """T_anchor_keyframe [n, 4, 4] of settled keyframes `ids` [n], and their anchors [n]."""
        T, anchors = np.tile(np.eye(4), (len(ids), 1, 1)), np.empty(len(ids), np.int64)
        for slab, mine, rows in self._slabs.of(ids):
            T[mine, :3] = self._slabs.relative(int(ids[mine[0]]) // SLAB_ROWS)[rows]
            anchors[mine] = slab.meta[rows, _ANCHOR]
        return T, anchors

    def _are_settled(self, ids: np.ndarray) -> np.ndarray:
        """[n] bool, of keyframes `ids` [n]."""
        flags = np.empty(len(ids), np.int64)
        for slab, mine, rows in self._slabs.of(ids):
            flags[mine] = slab.meta[rows, _FLAGS]
        return flags & _SETTLED > 0

    def _meta(self, k: int) -> np.ndarray:
        return self._slabs.slab(k // SLAB_ROWS).meta[k % SLAB_ROWS]

    def _column(self, column: int, count: int) -> np.ndarray:
        out = np.empty(count, np.int64)
        for s in range(-(-count // SLAB_ROWS)):
            part = out[s * SLAB_ROWS : (s + 1) * SLAB_ROWS]
            part[:] = self._slabs.slab(s).meta[: len(part), column]
        return out


def _live(is_settled: np.ndarray, slab: int) -> slice | np.ndarray:
    """The rows of a slab that have poses of their own; all of them as a slice. `is_settled`: of all, [n]."""
    mine = is_settled[slab * SLAB_ROWS : (slab + 1) * SLAB_ROWS]
    return np.flatnonzero(~mine) if mine.any() else slice(None)
