"""Every pose as it was published, in named arrays: what trajectories and latencies come from."""

import contextlib
from bisect import bisect_left
from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.map.allocator import ArrayAllocator, UnreadableArrayError
from hsslam_node.map.memory_order import load_ordered, store_ordered

SLAB_ROWS = 1024
_RESERVE_EVERY = 64  # rows
INITIAL, TRACKED, LOST, DEAD_RECKONED = 0, 1, 2, 3  # status
Status = Literal["initial", "tracked", "lost", "dead_reckoned"]
STATUS: dict[Status, int] = {
    "initial": INITIAL,
    "tracked": TRACKED,
    "lost": LOST,
    "dead_reckoned": DEAD_RECKONED,  # by odometry alone: the camera saw nothing to be aligned to
}
_HEADER, _NEWEST, _SLAB = "pose_header", "pose_newest", "pose_log."  # names of arrays
_JOINS, _JOIN = "pose_joins", "pose_join."
MOST_FRAGMENTS = 65_535
_COUNT, _FRAGMENT, _NOT_LOGGED = 0, 1, 2  # fields of the header
_MOST_CAMERAS = 64  # whose newest rows are noted

POSE_ROW = np.dtype(
    [
        ("publisher", "<i8"),  # the camera of the frame
        ("index", "<i8"),  # of the frame
        ("source_stamp_ns", "<i8"),
        ("stamp_ns", "<i8"),  # wall clock of the sensor
        ("publish_ns", "<i8"),  # wall clock
        ("publish_monotonic_ns", "<i8"),  # monotonic clock: latencies must not have steps
        ("status", "<i8"),  # one of STATUS
        ("keyframe", "<i8"),  # id of the reference keyframe, -1: none
        ("T_world_cam", "<f8", (4, 4)),
        ("T_keyframe_cam", "<f8", (4, 4)),
        ("quality", "<f8"),  # 0 to 1
        ("map_version", "<i8"),  # that the frame was aligned to
        ("pose_version", "<i8"),  # of the keyframes' poses that it was aligned to
        ("map_epoch", "<i8"),  # which map, in a coordinate frame of its own: each reset begins one
        # of T_world_cam, as in `geometry/pose_covariance.py`; or nan
        ("covariance", "<f8", (6, 6)),
        ("T_odom_cam", "<f8", (4, 4)),  # the path without jumps that corrections make
        ("odometry_stands", "<i8"),  # 1: that path does not know the motion to this frame
        # that pose and keyframe are of, if the frame is LOST to the map; 0: none
        ("fragment", "<i8"),
        ("is_reckoned", "<i8"),  # 1: odometry alone placed it in the fragment
    ]
)
_JOIN_ROW = np.dtype([("keyframe", "<i8"), ("T_keyframe_own", "<f8", (4, 4))])


class PoseLog:
    """Append-only rows of `POSE_ROW`. One writer; a reader sees only complete rows.

    A restarted writer goes on behind the last complete row. Creating and attaching are the same. The
    log outlives a map that is thrown away: rows say of which map epoch they are. A log of days has more
    rows than the memory holds: only `rows` copies all of them.

    If the disk does not give a slab, lost frames without a publisher take the place of its rows, with stamps
    and map epoch of the row before. `unreadable` counts them.

    Args:
        arrays: hold the rows, in slabs.
        on_full: takes the name of a slab that is full, which nothing writes any more; `append` does not read
            it again, so it may move to a disk that is slow or hangs.
    """

    def __init__(
        self, arrays: ArrayAllocator, on_full: Callable[[str], object] | None = None
    ) -> None:
        self._arrays = arrays
        self._on_full = on_full
        self._header = arrays.create(_HEADER, (16,), np.int64)
        # of each camera the number of its newest row, counted from 1; 0: none
        self._newest = arrays.create(_NEWEST, (_MOST_CAMERAS,), np.int64)
        # keyframes of each fragment, if it has joined the map; else 0
        self._joins = arrays.create(_JOINS, (MOST_FRAGMENTS + 1,), np.int64)
        self._slabs: dict[int, np.ndarray] = {}  # those that are not full
        self._unreadable: dict[int, str] = {}  # full ones that could not be read, and why
        self._noted_at = {
            int(self._row(n - 1)["publisher"]): k for k, n in enumerate(self._newest.tolist()) if n
        }
        self._told = 0  # full slabs
        self._tell_full((self.count - 1) // SLAB_ROWS)

    @property
    def count(self) -> int:
        """Complete rows."""
        return load_ordered(self._header, _COUNT)

    @property
    def not_logged(self) -> int:
        """Rows of all writers that the memory had no room for."""
        return load_ordered(self._header, _NOT_LOGGED)

    @property
    def unreadable(self) -> str:
        """How many rows the disk did not give this reader so far, and the first reason; empty if none."""
        if not self._unreadable:
            return ""
        why = next(iter(self._unreadable.values()))
        return f"{why}: {len(self._unreadable) * SLAB_ROWS} poses cannot be read"

    def append(self, row: np.ndarray | np.void) -> bool:
        """Add one row, a scalar of `POSE_ROW`; `pose_row` makes one. False: there is no memory for it.

        Raises:
            OutOfMemoryError: not even for the first.
        """
        n = self.count
        if n:
            self._note(n)
            self._tell_full(n // SLAB_ROWS)
        try:
            self._slab(n // SLAB_ROWS)[n % SLAB_ROWS] = row
        except OutOfMemoryError:
            if n == 0:
                raise
            store_ordered(self._header, _NOT_LOGGED, self.not_logged + 1)
            return False
        store_ordered(self._header, _COUNT, n + 1)
        if (n + 1) % SLAB_ROWS == 0:
            self._slabs.pop(n // SLAB_ROWS, None)
        if n % _RESERVE_EVERY == 0:  # early, while there is some; else another time
            with contextlib.suppress(OutOfMemoryError):
                self._slab((n + SLAB_ROWS // 2) // SLAB_ROWS)
        return True

    def last(self) -> np.ndarray | None:
        """A copy of the newest row, None if there is none."""
        n = self.count
        return None if n == 0 else self._row(n - 1).copy()

    def find(self, publisher: int, index: int) -> np.ndarray | None:
        """A copy of the newest row of a camera's frame, None if there is none."""
        for rows in self.slabs(newest_first=True):
            of_it = rows["publisher"] == publisher
            found = np.flatnonzero(of_it & (rows["index"] == index))
            if len(found):
                return rows[found[-1]].copy()
            if (of_it & (rows["index"] < index)).any():  # a camera counts upwards
                return None
        return None

    def newest_of_each(self) -> list[np.ndarray]:
        """Copies of the newest row of each camera, in order of their age; of 64 cameras, the newest ones."""
        newest: dict[int, np.ndarray] = {}
        for n in sorted({*self._newest.tolist(), self.count} - {0}):
            row = self._row(n - 1).copy()
            newest.pop(int(row["publisher"]), None)
            newest[int(row["publisher"])] = row
        return list(newest.values())

    def rows(self) -> np.ndarray:
        """All complete rows, [N] of POSE_ROW, copied."""
        slabs = list(self.slabs())
        return np.concatenate(slabs) if slabs else np.zeros(0, POSE_ROW)

    def slabs(
        self, rows: range | None = None, *, newest_first: bool = False
    ) -> Iterator[np.ndarray]:
        """The rows of these numbers, or all, as views: [n] of POSE_ROW, some thousand at a time."""
        rows = range(self.count) if rows is None else rows
        numbers = range(rows.start // SLAB_ROWS, -(-rows.stop // SLAB_ROWS))
        for k in reversed(numbers) if newest_first else numbers:
            first = k * SLAB_ROWS
            yield self._slab(k)[max(rows.start - first, 0) : rows.stop - first]

    def rows_of_epoch(self, map_epoch: int) -> range:
        """Numbers of the rows of one map epoch: only they have poses in one coordinate frame."""
        numbers = range(self.count)
        start, stop = (
            bisect_left(numbers, epoch, key=lambda n: int(self._row(n)["map_epoch"]))
            for epoch in (map_epoch, map_epoch + 1)
        )
        return numbers[start:stop]

    def newest_fragment(self) -> int:
        """The largest number of a fragment in the log; 0: there was none."""
        last = self.last()
        noted = load_ordered(self._header, _FRAGMENT)
        return noted if last is None else max(noted, int(last["fragment"]))

    def prepare_join(
        self, fragment: int, keyframes: np.ndarray, T_keyframe_own: np.ndarray
    ) -> None:
        """A fragment is about to join the map: its keyframe k will move with keyframe `keyframes[k]` of the
        map, from where it is T_keyframe_own[k] [4, 4] away. `join` makes it count.

        Raises:
            OutOfMemoryError: there is no memory to note it.
        """
        rows = self._arrays.create(_join_name(fragment), (len(keyframes),), _JOIN_ROW)
        rows["keyframe"], rows["T_keyframe_own"] = keyframes, T_keyframe_own

    def join(self, fragment: int) -> None:
        """The map has the keyframes of a fragment whose join was prepared."""
        store_ordered(self._joins, fragment, len(self._arrays.open(_join_name(fragment))))

    def is_joined(self, fragment: int) -> bool:
        """Whether a fragment has joined the map."""
        return load_ordered(self._joins, fragment) > 0

    def joined(self, rows: np.ndarray) -> np.ndarray:
        """Rows [N] of this log; those of fragments that have joined the map are tracked in it, or
        dead-reckoned, in a copy.

        `T_world_cam` of these stays what it was in the fragment: `keyframe` says where they are.
        """
        joined = [f for f in np.unique(rows["fragment"]).tolist() if f and self.is_joined(f)]
        rows = rows.copy() if joined else rows
        for fragment in joined:
            of_it = np.flatnonzero(rows["fragment"] == fragment)
            keyframes = self._arrays.open(_join_name(fragment))[rows["keyframe"][of_it]]
            T_keyframe_cam = keyframes["T_keyframe_own"] @ rows["T_keyframe_cam"][of_it]
            is_reckoned = rows["is_reckoned"][of_it] == 1
            rows["status"][of_it] = np.where(is_reckoned, DEAD_RECKONED, TRACKED)
            rows["fragment"][of_it] = 0
            rows["keyframe"][of_it] = keyframes["keyframe"]
            rows["T_keyframe_cam"][of_it] = T_keyframe_cam
        return rows

    @staticmethod
    def owns(name: str) -> bool:
        """Whether an array of this name belongs to a pose log."""
        return name in (_HEADER, _NEWEST, _JOINS) or name.startswith((_SLAB, _JOIN))

    def _tell_full(self, slabs: int) -> None:
        """Call `on_full` once for each of the first `slabs` slabs, which are full and noted."""
        for k in range(self._told, slabs):
            self._told = k + 1
            if self._on_full is not None:
                self._on_full(_slab_name(k))

    def _note(self, n: int) -> None:
        """Note the last of n rows. All rows but the last are noted, whenever the writer dies."""
        row = self._row(n - 1)
        publisher = int(row["publisher"])
        if publisher not in self._noted_at:
            # free, or of the camera that has been silent for longest
            k = int(self._newest.argmin())
            self._noted_at = {p: j for p, j in self._noted_at.items() if j != k} | {publisher: k}
        store_ordered(self._newest, self._noted_at[publisher], n)
        if row["fragment"] > self._header[_FRAGMENT]:
            store_ordered(self._header, _FRAGMENT, int(row["fragment"]))

    def _row(self, number: int) -> np.ndarray:
        """A row as a view, [] of POSE_ROW, by its number from 0."""
        return self._slab(number // SLAB_ROWS)[number % SLAB_ROWS]

    def _slab(self, k: int) -> np.ndarray:
        slab = self._slabs.get(k)
        if slab is None:
            slab = self._opened(k)
            if slab is None:
                return self._lost_slab(k)
            full = self.count // SLAB_ROWS
            self._slabs = {j: held for j, held in self._slabs.items() if j >= full}
            if k >= full:
                self._slabs[k] = slab
        return slab

    def _opened(self, k: int) -> np.ndarray | None:
        """A slab, [SLAB_ROWS] of POSE_ROW; None if the disk does not give it. It is not tried again."""
        if k not in self._unreadable:
            try:
                return self._arrays.create(_slab_name(k), (SLAB_ROWS,), POSE_ROW)
            except UnreadableArrayError as error:
                self._unreadable[k] = str(error.strerror)
        return None

    def _lost_slab(self, k: int) -> np.ndarray:
        """Rows in place of those of a slab that cannot be read, after the last row before it that can."""
        rows = np.zeros(SLAB_ROWS, POSE_ROW)
        others = [*range(k - 1, -1, -1), *range(k + 1, -(-self.count // SLAB_ROWS))]
        near = next(((j, slab) for j in others if (slab := self._opened(j)) is not None), None)
        if near is not None:
            rows[:] = near[1][-1 if near[0] < k else 0]
        rows["publisher"], rows["status"], rows["keyframe"], rows["fragment"] = -1, LOST, -1, 0
        return rows


def _slab_name(k: int) -> str:
    return f"{_SLAB}{k:03d}"


def _join_name(fragment: int) -> str:
    return f"{_JOIN}{fragment:04d}"


def pose_row(
    *,
    index: int,
    source_stamp_ns: int,
    stamp_ns: int,
    publish_ns: int,
    publish_monotonic_ns: int = 0,
    status: int,
    keyframe: int,
    T_world_cam: np.ndarray,  # [4, 4]
    T_keyframe_cam: np.ndarray,  # [4, 4]
    quality: float,
    map_version: int,
    pose_version: int = 0,
    map_epoch: int = 0,
    publisher: int = 0,
    covariance: np.ndarray | None = None,  # [6, 6]
    T_odom_cam: np.ndarray | None = None,  # [4, 4]; None: the world's
    fragment: int = 0,
    is_reckoned: bool = False,
) -> np.ndarray:
    """One row, [] of POSE_ROW."""
    row = np.zeros((), POSE_ROW)
    row["index"], row["source_stamp_ns"] = index, source_stamp_ns
    row["stamp_ns"], row["publish_ns"] = stamp_ns, publish_ns
    row["publish_monotonic_ns"] = publish_monotonic_ns
    row["status"], row["keyframe"] = status, keyframe
    row["T_world_cam"], row["T_keyframe_cam"] = T_world_cam, T_keyframe_cam
    row["quality"], row["map_version"], row["map_epoch"] = quality, map_version, map_epoch
    row["pose_version"], row["publisher"], row["fragment"] = pose_version, publisher, fragment
    row["is_reckoned"] = is_reckoned
    row["covariance"] = np.nan if covariance is None else covariance
    row["T_odom_cam"] = T_world_cam if T_odom_cam is None else T_odom_cam
    return row
