"""A pose log of many frames, made at once; shared by tests of library and service."""

import numpy as np

from hsslam_node.geometry.se3_batch import exp_batch
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.pose_log import DEAD_RECKONED, LOST, POSE_ROW, SLAB_ROWS, TRACKED, PoseLog

COUNT = 3 * SLAB_ROWS + 50
KEYFRAMES = exp_batch(np.random.default_rng(1).normal(size=(4, 6)))  # [4, 4, 4] as they are now
FIRST_OF_LAST_EPOCH = 100  # number of the row
_JOINED, _NOT_JOINED = 1, 2  # fragments


def long_rows() -> np.ndarray:
    """[COUNT] of POSE_ROW: two map epochs, lost frames, two fragments, and stretches by odometry alone.

    These are at the beginning of the last epoch, at borders of slabs, at the end; one has a path that is
    not known as a whole."""
    rng, rows = np.random.default_rng(0), np.zeros(COUNT, POSE_ROW)
    number = np.arange(COUNT)
    rows["index"], rows["map_epoch"] = number, number >= FIRST_OF_LAST_EPOCH
    rows["status"], rows["keyframe"] = TRACKED, number % (len(KEYFRAMES) + 1) - 1
    rows["source_stamp_ns"] = number * 33_000_000
    rows["stamp_ns"] = 10**18 + rows["source_stamp_ns"]
    rows["publish_ns"] = rows["stamp_ns"] + rng.integers(10**7, 3 * 10**7, COUNT)
    for name in ("T_world_cam", "T_keyframe_cam", "T_odom_cam"):
        rows[name] = exp_batch(rng.normal(scale=0.1, size=(COUNT, 6)))
    rows["status"][number % 97 == 0] = LOST
    for first, count in ((FIRST_OF_LAST_EPOCH, 4), (SLAB_ROWS - 3, 7), (2 * SLAB_ROWS - 5, 5)):
        rows["status"][first : first + count] = DEAD_RECKONED
    rows["status"][-3:] = DEAD_RECKONED
    unknown = slice(3 * SLAB_ROWS - 2, 3 * SLAB_ROWS + 3)
    rows["status"][unknown], rows["odometry_stands"][unknown] = DEAD_RECKONED, True
    starts = ((_JOINED, 200), (_NOT_JOINED, SLAB_ROWS - 20), (_NOT_JOINED, SLAB_ROWS + 20))
    for fragment, first in starts:
        of_it = slice(first, first + 10)
        rows["fragment"][of_it], rows["status"][of_it] = fragment, LOST
        rows["keyframe"][of_it] = np.arange(10) % 2
    return rows


def long_log(arrays: ArrayAllocator) -> PoseLog:
    """The log of `long_rows`, as a tracker has left it."""
    rows = long_rows()
    for start in range(0, COUNT, SLAB_ROWS):
        part = rows[start : start + SLAB_ROWS]
        slab = arrays.create(f"pose_log.{start // SLAB_ROWS:03d}", (SLAB_ROWS,), POSE_ROW)
        slab[: len(part)] = part
    log = PoseLog(arrays)
    arrays.open("pose_header")[0] = COUNT
    log.prepare_join(_JOINED, np.array([3, 1]), KEYFRAMES[:2])
    log.join(_JOINED)
    return log
