"""Rows of keyframes, kept for ever: stamp, pose, slot of the pixels, anchor."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.map.allocator import ArrayAllocator

SLAB_ROWS = 4096  # 3.0 MB, with gaps 4.2 MB
# columns; the loss is a float64
_FRAME_INDEX, _STAMP_NS, _SLOT, _ANCHOR, _VERSION, _LOSS, _FRAGMENT, _DUE, _HAS_GAP = range(9)
_COLUMNS = 9
_LEAST_LOSS = np.finfo(np.float64).tiny  # 0 stands for an unknown loss


class _Slab(NamedTuple):
    meta: np.ndarray  # [SLAB_ROWS, _COLUMNS] int64
    poses: np.ndarray  # [2, SLAB_ROWS, 4, 4] T_world_cam of both banks
    covariances: np.ndarray  # [SLAB_ROWS, 6, 6] of the pose
    # [SLAB_ROWS, 4, 4] T_world_cam at which the mapper last saw the keyframe; 0: never
    mapped: np.ndarray


class KeyframeRows:
    """Append-only rows in slabs, so that their number has no limit: 740 bytes each, and 290 more in a slab
    with motions by odometry alone.

    Poses lie in two banks that readers copy without a lock. The owner of the rows knows how many are
    complete, and which bank is current.
    """

    def __init__(self, arrays: ArrayAllocator) -> None:
        self._arrays = arrays
        self._slabs: dict[int, _Slab] = {}  # by number; threads may open one at once
        # [SLAB_ROWS, 6, 6], by number: covariances of motions by odometry alone, if a row has one
        self._gaps: dict[int, np.ndarray] = {}

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
    ) -> None:
        """Write row k before any process reads it; T_world_cam [4, 4] is of pose version `version`.

        covariance: [6, 6] of the pose, as in `geometry/pose_covariance.py`.
        gap_covariance: [6, 6] as in `KeyframeStore.append`. fragment: see `fragments`.

        Raises:
            OutOfMemoryError: there is no room for another slab of rows.
        """
        slab = self._slab(k // SLAB_ROWS, create=True)
        row = k % SLAB_ROWS
        slab.meta[row, :5] = frame_index, stamp_ns, slot, -1, version
        slab.meta[row, _FRAGMENT] = fragment
        slab.poses[:, row] = T
        slab.covariances[row] = covariance
        slab.meta[row, _HAS_GAP] = has_gap = bool(np.any(gap_covariance))
        if has_gap:
            self._slab_gaps(k // SLAB_ROWS, create=True)[row] = gap_covariance

    def reserve(self, k: int, has_gap: bool) -> bool:
        """The tracker only: make room for row k, with or without a gap; False if there is no memory."""
        try:
            self._slab(k // SLAB_ROWS, create=True)
            if has_gap:
                self._slab_gaps(k // SLAB_ROWS, create=True)
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
        for slab, mine, rows in self._by_slab(ids):
            slab.meta.view(np.float64)[rows, _LOSS] = np.maximum(losses[mine], _LEAST_LOSS)

    def losses(self, ids: np.ndarray) -> np.ndarray:
        """The newest losses of keyframes `ids` [n], [n] float64; nan: not known."""
        noted = np.empty(len(ids))
        for slab, mine, rows in self._by_slab(ids):
            noted[mine] = slab.meta.view(np.float64)[rows, _LOSS]
        return np.where(noted > 0, noted, np.nan)

    def note_mapped(self, ids: np.ndarray, T_world_cam: np.ndarray, due: np.ndarray) -> None:
        """The mapper only: see `KeyframeStore.note_mapped`."""
        for slab, mine, rows in self._by_slab(ids):
            slab.meta[rows, _DUE] = due[mine]
            slab.mapped[rows] = T_world_cam[mine]

    def mapped(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What `note_mapped` noted of keyframes `ids` [n]: T_world_cam [n, 4, 4] and due [n] int64."""
        T_world_cam, due = np.empty((len(ids), 4, 4)), np.empty(len(ids), np.int64)
        for slab, mine, rows in self._by_slab(ids):
            T_world_cam[mine], due[mine] = slab.mapped[rows], slab.meta[rows, _DUE]
        return T_world_cam, due

    def covariance(self, k: int) -> np.ndarray:
        """[6, 6] of the pose that keyframe k was appended with, copied."""
        return self._slab(k // SLAB_ROWS).covariances[k % SLAB_ROWS].copy()

    def gap_covariance(self, k: int) -> np.ndarray:
        """[6, 6] of the gap before keyframe k, as in `KeyframeStore.append`, copied."""
        if not self._meta(k)[_HAS_GAP]:
            return np.zeros((6, 6))
        return self._slab_gaps(k // SLAB_ROWS)[k % SLAB_ROWS].copy()

    def pose(self, k: int, bank: int) -> np.ndarray:
        """T_world_cam [4, 4] of keyframe k, copied."""
        return self._slab(k // SLAB_ROWS).poses[bank, k % SLAB_ROWS].copy()

    def poses(self, ids: np.ndarray, bank: int) -> np.ndarray:
        """T_world_cam [n, 4, 4] of keyframes `ids` [n], copied."""
        out = np.empty((len(ids), 4, 4))
        for slab, mine, rows in self._by_slab(ids):
            out[mine] = slab.poses[bank, rows]
        return out

    def all_poses(self, count: int, bank: int) -> np.ndarray:
        """T_world_cam [count, 4, 4] of the first `count` keyframes, copied."""
        out = np.empty((count, 4, 4))
        for s in range(-(-count // SLAB_ROWS)):
            part = out[s * SLAB_ROWS : (s + 1) * SLAB_ROWS]
            part[:] = self._slab(s).poses[bank, : len(part)]
        return out

    def write_bank(self, poses: np.ndarray, bank: int) -> None:
        """Overwrite the poses of the first keyframes in the bank that no process reads, [n, 4, 4]."""
        for s in range(-(-len(poses) // SLAB_ROWS)):
            part = poses[s * SLAB_ROWS : (s + 1) * SLAB_ROWS]
            self._slab(s).poses[bank, : len(part)] = part

    def _by_slab(self, ids: np.ndarray) -> Iterator[tuple[_Slab, np.ndarray, np.ndarray]]:
        """Each slab that has keyframes of `ids` [n], the mask [n] of these, and their rows in it."""
        number = ids // SLAB_ROWS
        for s in np.unique(number):
            mine = number == s
            yield self._slab(int(s)), mine, ids[mine] % SLAB_ROWS

    def _meta(self, k: int) -> np.ndarray:
        return self._slab(k // SLAB_ROWS).meta[k % SLAB_ROWS]

    def _column(self, column: int, count: int) -> np.ndarray:
        out = np.empty(count, np.int64)
        for s in range(-(-count // SLAB_ROWS)):
            part = out[s * SLAB_ROWS : (s + 1) * SLAB_ROWS]
            part[:] = self._slab(s).meta[: len(part), column]
        return out

    def _slab(self, index: int, create: bool = False) -> _Slab:
        slab = self._slabs.get(index)
        if slab is None:
            names = [f"keyframe_{kind}.{index:03d}" for kind in _Slab._fields]
            if create:
                slab = _Slab(
                    self._arrays.create(names[0], (SLAB_ROWS, _COLUMNS), np.int64),
                    self._arrays.create(names[1], (2, SLAB_ROWS, 4, 4), np.float64),
                    self._arrays.create(names[2], (SLAB_ROWS, 6, 6), np.float64),
                    self._arrays.create(names[3], (SLAB_ROWS, 4, 4), np.float64),
                )
            else:
                slab = _Slab(*(self._arrays.open(name) for name in names))
            self._slabs[index] = slab
        return slab

    def _slab_gaps(self, index: int, create: bool = False) -> np.ndarray:
        gaps = self._gaps.get(index)
        if gaps is None:
            name = f"keyframe_gaps.{index:03d}"
            if create:
                gaps = self._arrays.create(name, (SLAB_ROWS, 6, 6), np.float64)
            else:
                gaps = self._arrays.open(name)
            self._gaps[index] = gaps
        return gaps
