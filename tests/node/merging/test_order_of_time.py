"""A merged map has the keyframes of the earlier run before those of the later one."""

import numpy as np

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.geometry.pose_covariance import UNTRACKED
from hsslam_node.map.checkpoint import MapCheckpoint
from hsslam_node.merging.order_of_time import in_order_of_time
from tests.small_room import SMALL
from tests.two_sessions import FIRST, SECOND, session, walk

_EARLY, _LATE = slice(0, 6), slice(6, None)


def _merged(first: slice, second: slice) -> MapCheckpoint:
    (store, parameters), (frames, poses) = session(first), walk()
    gap = UNTRACKED
    for frame, T in zip(frames[second], poses[second], strict=True):
        store.append(frame, T, gap_covariance=gap)
        gap = np.zeros((6, 6))
    return map_snapshot(store, parameters, SMALL)


def test_the_earlier_run_comes_first_whichever_is_named_first():
    frames, poses = walk()
    before = _merged(_LATE, _EARLY)
    found = in_order_of_time(before, 10)
    assert found.keyframe_stamps_ns.tolist() == [frame.stamp_ns for frame in frames]
    np.testing.assert_array_equal(found.T_world_keyframe[_EARLY], poses[_EARLY])
    np.testing.assert_allclose(
        found.T_world_keyframe[6], np.eye(4), atol=1e-12
    )  # world of the first
    assert found.images is not None and before.images is not None
    for k, frame in enumerate(frames):
        np.testing.assert_array_equal(found.images.depth_raw(k), frame.depth_raw)
        assert found.images.color_jpeg(k) == before.images.color_jpeg((k + 10) % 16)
    assert found.keyframe_gaps is not None
    assert np.flatnonzero(found.keyframe_gaps.any(axis=(1, 2))).tolist() == [6]


def test_an_order_that_is_right_or_not_known_stays():
    for first, second in ((_EARLY, _LATE), (FIRST, SECOND), (SECOND, FIRST)):
        merged = _merged(first, second)
        assert in_order_of_time(merged, len(range(*first.indices(16)))) is merged
