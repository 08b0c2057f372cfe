"""Tracking by rendering on a trained map: displaced frames come back, the rest as in any tracker."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.config import RenderingTrackerConfig
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.open_tracker import open_tracker
from hsslam_node.tracking.rendering_objective import RenderingObjective, descend
from hsslam_node.tracking.rendering_tracker import RenderingTracker
from hsslam_node.tracking.tracker import Tracker
from tests.small_room import (
    RENDERED,
    displaced,
    map_view,
    pose_error,
    room_frames,
    room_poses,
    with_black,
)

CONFIG = replace(
    RENDERED,
    tracker=replace(RENDERED.tracker, method="rendering"),
    rendering_tracker=RenderingTrackerConfig(
        pixels=800, iterations=15, border=0.02, fresh_pixels=False
    ),
)


@pytest.fixture(scope="module")
def view() -> MapView:
    return map_view(RENDERED)


def _tracker(config=CONFIG) -> tuple[RenderingTracker, KeyframeStore]:
    first = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)
    return RenderingTracker(config, store, 0), store


def _is_right(result, limit_m: float = 0.01) -> bool:
    """The camera moves 9.5 mm and 0.55 degrees a frame."""
    distance_m, angle_deg = pose_error(result.T_world_cam, room_poses()[result.frame_index])
    return result.status == "tracked" and distance_m < limit_m and angle_deg < 0.4


@pytest.mark.parametrize("k", [5, 14, 26])
def test_a_frame_displaced_by_two_centimetres_and_one_degree_comes_back(view, k):
    config = RenderingTrackerConfig(pixels=500, iterations=60, border=0.02, fresh_pixels=False)
    objective = RenderingObjective(replace(RENDERED, rendering_tracker=config), 0)
    objective.observe(room_frames()[k], view)
    start = displaced(room_poses()[k], 0.02, 1.0, seed=k)
    T = descend(objective, start, config)
    distance_m, angle_deg = pose_error(T, room_poses()[k])
    assert distance_m < 0.01 and angle_deg < 0.3
    assert objective(T)[0] < 0.5 * objective(start)[0]


def test_frames_are_tracked_and_every_fourth_becomes_a_keyframe(view):
    tracker, store = _tracker()
    first, *others = [tracker.track(frame, view) for frame in room_frames()[:10]]
    assert first.status == "initial" and first.is_keyframe
    assert all(map(_is_right, others))
    assert [r.frame_index for r in others if r.is_keyframe] == [4, 8]
    for r in others:
        np.testing.assert_allclose(
            store.pose(r.keyframe) @ r.T_keyframe_cam, r.T_world_cam, atol=1e-9
        )
        assert r.quality > 0.7 and 0 < r.residual_m < 0.02 and r.map_version == view.version
        R = r.T_world_cam[:3, :3]
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


def test_the_same_frames_give_the_same_poses_to_the_bit(view):
    trackers = [_tracker()[0] for _ in range(2)]
    for frame in room_frames()[:4]:
        a, b = (tracker.track(frame, view) for tracker in trackers)
        np.testing.assert_array_equal(a.T_world_cam, b.T_world_cam)


def test_a_black_frame_is_lost_and_the_next_is_tracked(view):
    tracker, _ = _tracker()
    frames = list(room_frames()[:5])
    frames[3] = with_black(frames[3])
    results = [tracker.track(frame, view) for frame in frames]
    assert [r.status for r in results] == ["initial", "tracked", "tracked", "lost", "tracked"]
    assert results[3].quality == 0 and not results[3].is_keyframe
    assert _is_right(results[4], 0.015)  # the start was two frames back


def test_while_the_motion_is_not_known_a_camera_may_move_farther_than_one_descent(view):
    def second(first_descents: int):
        settings = replace(CONFIG.rendering_tracker, iterations=8, first_descents=first_descents)
        tracker, _ = _tracker(replace(CONFIG, rendering_tracker=settings))
        tracker.track(room_frames()[0], view)
        return tracker.track(room_frames()[3], view)  # 29 mm; a descent goes 16 mm along an axis

    assert _is_right(second(4))
    assert not _is_right(second(1))


def test_a_pose_that_does_not_fit_the_map_is_not_published(view):
    tracker, _ = _tracker()
    tracker.track(room_frames()[0], view)
    far = replace(room_frames()[39], index=1, stamp_ns=room_frames()[1].stamp_ns)
    moved_m, _ = pose_error(room_poses()[39], room_poses()[0])
    assert moved_m > 0.1  # more than the descent can go
    assert tracker.track(far, view).status == "lost"
    assert _is_right(tracker.track(room_frames()[2], view), 0.015)  # two frames from the start


def test_without_a_map_frames_are_lost():
    tracker, _ = _tracker()
    assert tracker.track(with_black(room_frames()[0]), None).status == "lost"
    assert tracker.track(room_frames()[0], None).status == "initial"
    result = tracker.track(room_frames()[1], None)
    assert result.status == "lost" and result.keyframe == 0 and result.map_version == 0


def test_a_restarted_tracker_goes_on_from_the_newest_keyframe(view):
    tracker, store = _tracker()
    for frame in room_frames()[:5]:
        tracker.track(frame, view)
    again = RenderingTracker(CONFIG, store, 0)
    again.resume()
    result = again.track(room_frames()[5], view)
    assert _is_right(result) and result.keyframe == 1
    expected = inverse(store.pose(1)) @ result.T_world_cam
    np.testing.assert_allclose(result.T_keyframe_cam, expected, atol=1e-12)


def test_the_configuration_chooses_the_tracker():
    _, store = _tracker()
    assert isinstance(open_tracker(CONFIG, store, 0), RenderingTracker)
    assert isinstance(open_tracker(RENDERED, store, 0), Tracker)
