"""Every pose as it was published, in named arrays: what trajectories and latencies come from."""

import contextlib
from collections.abc import Callable
from typing import Literal

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.memory_order import load_ordered, store_ordered
from hsslam_node.odometry.spread_errors import spread_errors

SLAB_ROWS = 4096
_RESERVE_EVERY = 64  # rows
INITIAL, TRACKED, LOST, DEAD_RECKONED = 0, 1, 2, 3  # status
Status = Literal["initial", "tracked", "lost", "dead_reckoned"]
STATUS: dict[Status, int] = {
    "initial": INITIAL,
    "tracked": TRACKED,
    "lost": LOST,
    "dead_reckoned": DEAD_RECKONED,  # by odometry alone: the camera saw nothing to be aligned to
}
_HEADER, _SLAB = "pose_header", "pose_log."  # names of arrays
_JOINS, _JOIN = "pose_joins", "pose_join."
MOST_FRAGMENTS = 1023

POSE_ROW = np.dtype(
    [
        ("publisher", "<i8"),  # the camera of the frame
        ("index", "<i8"),  # of the frame
        ("source_stamp_ns", "<i8"),
        ("stamp_ns", "<i8"),  # wall clock of the sensor
        ("publish_ns", "<i8"),  # wall clock
        ("status", "<i8"),  # one of STATUS
        ("keyframe", "<i8"),  # id of the reference keyframe, -1: none
        ("T_world_cam", "<f8", (4, 4)),
        ("T_keyframe_cam", "<f8", (4, 4)),
        ("quality", "<f8"),  # 0 to 1
        ("map_version", "<i8"),  # that the frame was aligned to
        ("pose_version", "<i8"),  # of the keyframes' poses that it was aligned to
        ("map_epoch", "<i8"),  # which map, in a coordinate frame of its own: each reset begins one
        (
            "covariance",
            "<f8",
            (6, 6),
        ),  # of T_world_cam, as in `geometry/pose_covariance.py`; or nan
        ("T_odom_cam", "<f8", (4, 4)),  # the path without jumps that corrections make
        (
            "fragment",
            "<i8",
        ),  # that pose and keyframe are of, if the frame is LOST to the map; 0: none
    ]
)
_JOIN_ROW = np.dtype([("keyframe", "<i8"), ("T_keyframe_own", "<f8", (4, 4))])


class PoseLog:
    """Append-only rows of `POSE_ROW`. One writer; a reader sees only complete rows.

    A restarted writer goes on behind the last complete row. Creating and attaching are the same. The
    log outlives a map that is thrown away: rows say of which map epoch they are.

    Args:
        arrays: hold the rows, in slabs.
        on_full: takes the name of a slab that is full, which nothing writes any more.
    """

    def __init__(
        self, arrays: ArrayAllocator, on_full: Callable[[str], object] | None = None
    ) -> None:
        self._arrays = arrays
        self._on_full = on_full
        self._header = arrays.create(_HEADER, (16,), np.int64)  # [0] = rows
        # keyframes of each fragment, if it has joined the map; else 0
        self._joins = arrays.create(_JOINS, (MOST_FRAGMENTS + 1,), np.int64)
        self._slabs: dict[int, np.ndarray] = {}  # those that are not full
        for k in range(self.count // SLAB_ROWS):
            self._tell_full(k)

    @property
    def count(self) -> int:
        """Complete rows."""
        return load_ordered(self._header, 0)

    def append(self, row: np.ndarray | np.void) -> bool:
        """Add one row, a scalar of `POSE_ROW`; `pose_row` makes one. False: there is no memory for it.

        Raises:
            OutOfMemoryError: not even for the first.
        """
        n = self.count
        try:
            self._slab(n // SLAB_ROWS)[n % SLAB_ROWS] = row
        except OutOfMemoryError:
            if n == 0:
                raise
            return False
        store_ordered(self._header, 0, n + 1)
        if (n + 1) % SLAB_ROWS == 0:
            self._slabs.pop(n // SLAB_ROWS, None)
            self._tell_full(n // SLAB_ROWS)
        if n % _RESERVE_EVERY == 0:  # early, while there is some; else another time
            with contextlib.suppress(OutOfMemoryError):
                self._slab((n + SLAB_ROWS // 2) // SLAB_ROWS)
        return True

    def last(self) -> np.ndarray | None:
        """A copy of the newest row, None if there is none."""
        n = self.count
        return None if n == 0 else self._slab((n - 1) // SLAB_ROWS)[(n - 1) % SLAB_ROWS].copy()

    def find(self, publisher: int, index: int) -> np.ndarray | None:
        """A copy of the newest row of a camera's frame, None if there is none."""
        n = self.count
        for k in reversed(range(-(-n // SLAB_ROWS))):
            rows = self._slab(k)[: n - k * SLAB_ROWS]
            found = np.flatnonzero((rows["index"] == index) & (rows["publisher"] == publisher))
            if len(found):
                return rows[found[-1]].copy()
        return None

    def newest_of_each(self) -> np.ndarray:
        """The newest row of each camera, in order of their age, [N] of POSE_ROW."""
        rows = self.rows()
        _, last = np.unique(rows["publisher"][::-1], return_index=True)
        return rows[np.sort(len(rows) - 1 - last)]

    def rows(self) -> np.ndarray:
        """All complete rows, [N] of POSE_ROW, copied."""
        n = self.count
        slabs = [self._slab(k) for k in range(-(-n // SLAB_ROWS))]
        return np.concatenate(slabs)[:n] if slabs else np.zeros(0, POSE_ROW)

    def newest_fragment(self) -> int:
        """The largest number of a fragment in the log; 0: there was none."""
        slabs = map(self._slab, range(-(-self.count // SLAB_ROWS)))  # rows to come are 0
        return max((int(slab["fragment"].max()) for slab in slabs), default=0)

    def join(self, fragment: int, keyframes: np.ndarray, T_keyframe_own: np.ndarray) -> None:
        """A fragment has joined the map: its keyframe k moves with keyframe `keyframes[k]` of the map, from
        where it is T_keyframe_own[k] [4, 4] away.

        Raises:
            OutOfMemoryError: there is no memory to note it.
        """
        rows = self._arrays.create(_join_name(fragment), (len(keyframes),), _JOIN_ROW)
        rows["keyframe"], rows["T_keyframe_own"] = keyframes, T_keyframe_own
        store_ordered(self._joins, fragment, len(keyframes))  # last: it is complete

    def is_joined(self, fragment: int) -> bool:
        """Whether a fragment has joined the map."""
        return load_ordered(self._joins, fragment) > 0

    def joined(self, rows: np.ndarray) -> np.ndarray:
        """Rows [N] of this log; those of fragments that have joined the map are tracked in it, in a copy.

        `T_world_cam` of these stays what it was in the fragment: `keyframe` says where they are.
        """
        joined = [f for f in np.unique(rows["fragment"]).tolist() if f and self.is_joined(f)]
        rows = rows.copy() if joined else rows
        for fragment in joined:
            of_it = np.flatnonzero(rows["fragment"] == fragment)
            keyframes = self._arrays.open(_join_name(fragment))[rows["keyframe"][of_it]]
            T_keyframe_cam = keyframes["T_keyframe_own"] @ rows["T_keyframe_cam"][of_it]
            rows["status"][of_it], rows["fragment"][of_it] = TRACKED, 0
            rows["keyframe"][of_it] = keyframes["keyframe"]
            rows["T_keyframe_cam"][of_it] = T_keyframe_cam
        return rows

    @staticmethod
    def owns(name: str) -> bool:
        """Whether an array of this name belongs to a pose log."""
        return name in (_HEADER, _JOINS) or name.startswith((_SLAB, _JOIN))

    def _tell_full(self, k: int) -> None:
        if self._on_full is not None:
            self._on_full(_slab_name(k))

    def _slab(self, k: int) -> np.ndarray:
        slab = self._slabs.get(k)
        if slab is None:
            slab = self._arrays.create(_slab_name(k), (SLAB_ROWS,), POSE_ROW)
            if k >= self.count // SLAB_ROWS:
                self._slabs[k] = slab
        return slab


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
) -> np.ndarray:
    """One row, [] of POSE_ROW."""
    row = np.zeros((), POSE_ROW)
    row["index"], row["source_stamp_ns"] = index, source_stamp_ns
    row["stamp_ns"], row["publish_ns"] = stamp_ns, publish_ns
    row["status"], row["keyframe"] = status, keyframe
    row["T_world_cam"], row["T_keyframe_cam"] = T_world_cam, T_keyframe_cam
    row["quality"], row["map_version"], row["map_epoch"] = quality, map_version, map_epoch
    row["pose_version"], row["publisher"], row["fragment"] = pose_version, publisher, fragment
    row["covariance"] = np.nan if covariance is None else covariance
    row["T_odom_cam"] = T_world_cam if T_odom_cam is None else T_odom_cam
    return row


def of_map_epoch(rows: np.ndarray, map_epoch: int) -> np.ndarray:
    """The rows of one map epoch: only they have poses in one coordinate frame."""
    return _where(rows, rows["map_epoch"] == map_epoch)


def online_trajectory(rows: np.ndarray) -> Trajectory:
    """The poses as published at the time; lost frames have none."""
    kept = _where(rows, rows["status"] != LOST)
    return Trajectory(kept["source_stamp_ns"].copy(), kept["T_world_cam"].copy())


def final_trajectory(rows: np.ndarray, T_world_keyframe: np.ndarray) -> Trajectory:
    """Each pose carried along by its reference keyframe, [n, 4, 4]; lost frames have none.

    Poses by odometry alone are fitted in between the frames that were aligned before and after them.
    """
    kept = _where(rows, rows["status"] != LOST)
    poses = kept["T_world_cam"].copy()
    has_reference = (kept["keyframe"] >= 0) & (kept["keyframe"] < len(T_world_keyframe))
    reference = T_world_keyframe[kept["keyframe"][has_reference]]
    poses[has_reference] = reference @ kept["T_keyframe_cam"][has_reference]
    stamps_ns = kept["source_stamp_ns"].copy()
    poses = spread_errors(poses, kept["T_odom_cam"], kept["status"] == DEAD_RECKONED, stamps_ns)
    return Trajectory(stamps_ns, poses)


def fragment_trajectory(rows: np.ndarray, fragment: int) -> Trajectory:
    """The poses of a fragment, in a coordinate frame of its own."""
    kept = _where(rows, rows["fragment"] == fragment)
    return Trajectory(kept["source_stamp_ns"].copy(), kept["T_world_cam"].copy())


def _where(rows: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Rows of a mask [N]; the same array if these are all, as rows of an hour are 80 MB."""
    return rows if mask.all() else rows[mask]
