"""The tracker frame by frame: start, restart, odd stamps, keyframes."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.device.device import CPU
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import initial_bound
from hsslam_node.tracking.aligned.new_keyframes import NewKeyframes
from hsslam_node.tracking.map_view import MapView, MapViews, TornMapError
from hsslam_node.tracking.tracked_frame import TrackResult
from hsslam_node.tracking.tracker import Tracker
from hsslam_node.tracking.tracking_work import TrackingWork
from tests.noisy_depth import with_white_noise
from tests.small_room import SMALL, pose_error, room_frames, room_poses, with_black


def _store(capacity: int = 64) -> KeyframeStore:
    first = room_frames()[0]
    return KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, capacity)


def _tracked(store: KeyframeStore, frames) -> tuple[Tracker, list[TrackResult]]:
    tracker = Tracker(SMALL, store, 0)
    return tracker, [tracker.track(frame, None) for frame in frames]


def _is_right(result: TrackResult, index: int | None = None) -> bool:
    truth = room_poses()[result.frame_index if index is None else index]
    distance_m, angle_deg = pose_error(result.T_world_cam, truth)
    return result.status == "tracked" and distance_m < 0.005 and angle_deg < 0.3


def test_the_first_frame_with_depth_starts_the_world():
    store = _store()
    frames = room_frames()
    tracker, (first, second) = _tracked(store, [with_black(frames[0]), frames[1]])
    assert first.status == "lost" and first.keyframe == -1 and not first.is_keyframe
    assert second.status == "initial" and second.is_keyframe and second.quality == 1
    assert store.count == 1 and store.frame_indices().tolist() == [1]
    np.testing.assert_array_equal(second.T_world_cam, np.eye(4))
    third = tracker.track(frames[2], None)
    truth = inverse(room_poses()[1]) @ room_poses()[2]
    assert third.status == "tracked" and pose_error(third.T_world_cam, truth)[0] < 0.005


def test_a_map_in_a_given_box_begins_with_depth_that_counts():
    frame = room_frames()[0]
    given = replace(SMALL, bound=replace(SMALL.bound, box=(-9.0, -9.0, -9.0, 9.0, 9.0, 9.0)))
    all_too_far = replace(given, mapper=replace(SMALL.mapper, max_depth_m=0.1))
    for config, status in ((given, "initial"), (all_too_far, "lost")):
        assert Tracker(config, _store(), 0).track(frame, None).status == status


def test_keyframes_come_half_as_often_if_asked():
    tracker = Tracker(SMALL, _store(), 0)
    tracker.limit_work(TrackingWork(keyframes_every=2))
    results = [tracker.track(frame, None) for frame in room_frames()[:14]]
    assert all(map(_is_right, results[1:]))
    assert [r.frame_index for r in results if r.is_keyframe] == [0, 8]
    tracker.limit_work(TrackingWork())
    assert tracker.track(room_frames()[14], None).is_keyframe


def test_frames_are_tracked_and_every_fourth_becomes_a_keyframe():
    store = _store()
    _, results = _tracked(store, room_frames()[:14])
    assert all(map(_is_right, results[1:]))
    assert [r.frame_index for r in results if r.is_keyframe] == [0, 4, 8, 12]
    assert [r.keyframe for r in results] == [0] * 4 + [1] * 4 + [2] * 4 + [3] * 2
    assert store.frame_indices().tolist() == [0, 4, 8, 12]
    for r in results:
        np.testing.assert_allclose(
            store.pose(r.keyframe) @ r.T_keyframe_cam, r.T_world_cam, atol=1e-9
        )
        R = r.T_world_cam[:3, :3]
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert 0.5 < r.quality <= 1 and np.isnan(r.residual_m) and r.map_version == 0


def test_the_same_frames_give_the_same_poses_to_the_bit():
    runs = [_tracked(_store(), room_frames()[:6])[1] for _ in range(2)]
    for a, b in zip(*runs, strict=True):
        np.testing.assert_array_equal(a.T_world_cam, b.T_world_cam)


@pytest.mark.parametrize("count", [1, 3])
def test_blacked_out_frames_are_lost_and_the_next_is_tracked(count):
    store = _store()
    frames = list(room_frames()[:10])
    frames[5 : 5 + count] = [with_black(f) for f in frames[5 : 5 + count]]
    _, results = _tracked(store, frames)
    lost = [r for r in results if r.status == "lost"]
    assert [r.frame_index for r in lost] == list(range(5, 5 + count))
    assert all(r.quality == 0 and not r.is_keyframe for r in lost)
    assert all(_is_right(r) for r in results[1:] if r.status != "lost")


def test_colour_alone_going_dark_does_not_lose_the_camera():
    frames = list(room_frames()[:8])
    frames[5] = replace(frames[5], color=np.zeros_like(frames[5].color))
    _, results = _tracked(_store(), frames)
    assert all(_is_right(r) for r in results[1:5] + results[6:])


def test_resume_goes_on_from_the_newest_keyframe():
    store = _store()
    frames = room_frames()
    _tracked(store, frames[:9])
    successor = Tracker(SMALL, store, 0)
    successor.resume()
    results = [successor.track(frame, None) for frame in frames[9:20]]
    assert all(map(_is_right, results))
    assert store.frame_indices().tolist() == [0, 4, 8, 12, 16]


def test_poses_follow_corrected_keyframes():
    store = _store()
    frames = room_frames()
    tracker, _ = _tracked(store, frames[:7])
    world = se3_exp(np.array([0.3, 0.1, -0.2, 0.1, 0.2, 0.3]))
    store.correct_poses(np.arange(2), world @ store.poses())
    result = tracker.track(frames[7], None)
    assert _is_right(replace(result, T_world_cam=inverse(world) @ result.T_world_cam))


def test_a_stamp_twice_and_a_long_pause_do_no_harm():
    frames = room_frames()
    again = replace(frames[5], index=6)
    late = replace(frames[6], index=7, stamp_ns=frames[6].stamp_ns + 10_000_000_000)
    after = replace(frames[7], index=8, stamp_ns=late.stamp_ns + 33_333_333)
    _, results = _tracked(_store(), [*frames[:6], again, late, after])
    assert _is_right(results[6], 5) and _is_right(results[7], 6) and _is_right(results[8], 7)


@pytest.mark.parametrize("gap_ns", [0, 33_333_333, 10**10, -(10**10)])
def test_extrapolation_is_limited(gap_ns):
    """A lost frame's pose is the prediction: at most four times the last motion, never backwards."""
    later_ns = 20_000_000_000  # so that no stamp is below 0
    frames = [replace(f, stamp_ns=f.stamp_ns + later_ns) for f in room_frames()[:7]]
    tracker, results = _tracked(_store(), frames[:6])
    dark = with_black(frames[6], stamp_ns=frames[5].stamp_ns + gap_ns)
    prediction = tracker.track(dark, None).T_world_cam
    motion = se3_log(inverse(results[4].T_world_cam) @ results[5].T_world_cam)
    share = np.clip(gap_ns / (frames[5].stamp_ns - frames[4].stamp_ns), 0, 4)
    expected = results[5].T_world_cam @ se3_exp(share * motion)
    np.testing.assert_allclose(prediction, expected, atol=1e-8)


def test_a_full_store_ends_nothing():
    store = _store(capacity=2)
    _, results = _tracked(store, room_frames()[:12])
    assert all(map(_is_right, results[1:])) and store.count == 2 and store.room.refused > 0


def test_a_camera_that_stands_still_adds_no_keyframe_until_it_moves():
    frames, store = room_frames(), _store()
    config = replace(SMALL, keyframes=replace(SMALL.keyframes, still=3))
    tracker = Tracker(config, store, 0)
    rng = np.random.default_rng(0)

    def seen(k: int, index: int) -> Frame:
        noise = rng.normal(0, 2.0, frames[k].color.shape)
        color = np.clip(frames[k].color + noise, 0, 255).astype(np.uint8)
        return replace(frames[k], index=index, stamp_ns=33_000_000 * index, color=color)

    for index in range(40):
        assert tracker.track(seen(0, index), None).status != "lost"
    assert store.count == 4  # the first, and three of one view
    for index in range(40, 60):
        assert tracker.track(seen(index - 40, index), None).status == "tracked"
    assert store.count > 7
    count = store.count
    for index in range(60, 110):
        assert tracker.track(seen(19, index), None).status == "tracked"
    assert store.count <= count + 4


def test_a_pose_that_was_corrected_while_its_frame_was_aligned_follows():
    frames, store = room_frames(), _store()
    tracker, _ = _tracked(store, frames[:6])
    move = se3_exp(np.array([0.02, 0.01, 0, 0, 0.01, 0]))
    corrections = [move]

    def corrected_meanwhile() -> bool:
        """Asked at the end of an alignment."""
        if corrections:
            store.correct_poses(np.arange(store.count), corrections.pop() @ store.poses())
        return True

    view = replace(_all_free(frames[0]), is_intact=corrected_meanwhile)
    result = tracker.track(frames[6], view)
    assert not corrections
    T = inverse(move) @ result.T_world_cam
    assert pose_error(T, room_poses()[6])[0] < 0.002 and result.status == "tracked"
    np.testing.assert_allclose(store.pose(result.keyframe) @ result.T_keyframe_cam, move @ T)


def test_a_correction_while_a_tracked_frame_is_accepted_moves_its_keyframe_and_it_together(
    monkeypatch,
):
    frames, store = room_frames(), _store()
    tracker, _ = _tracked(store, frames[:6])
    expected = _tracked(_store(), frames[:7])[1][-1]
    move = se3_exp(np.array([0.5, 0.1, 0, 0, 0.3, 0]))
    is_due = NewKeyframes.is_due

    def corrected_meanwhile(*args: object, **named: object) -> bool:
        """Asked after the pose of the frame was read, before that of its keyframe."""
        store.correct_poses(np.arange(store.count), move @ store.poses())
        return is_due(*args, **named)

    monkeypatch.setattr(NewKeyframes, "is_due", corrected_meanwhile)
    result = tracker.track(frames[6], None)
    assert (result.pose_version, result.is_keyframe) == (store.pose_version, False)
    np.testing.assert_allclose(result.T_keyframe_cam, expected.T_keyframe_cam, atol=1e-9)
    np.testing.assert_allclose(result.T_world_cam, move @ expected.T_world_cam, atol=1e-9)


def test_a_map_that_lags_behind_does_not_lose_the_camera():
    frames = room_frames()[:10]
    tracker = Tracker(SMALL, _store(), 0)
    view = _all_free(frames[0])
    results = [tracker.track(frame, view) for frame in frames]
    assert max(r.quality for r in results[1:]) < SMALL.tracker.min_inlier_ratio
    assert all(map(_is_right, results[1:]))


def test_a_tracker_leaves_the_map_out_if_asked_but_not_while_the_camera_is_lost():
    frames = room_frames()[:12]
    tracker, without = (Tracker(SMALL, _store(), 0) for _ in range(2))
    tracker.limit_work(TrackingWork(uses_map=False))
    view = _all_free(frames[0])
    for frame in frames[:8]:
        result, expected = tracker.track(frame, view), without.track(frame, None)
        np.testing.assert_array_equal(result.T_world_cam, expected.T_world_cam)
        assert result.map_version == 0
    assert tracker.track(with_black(frames[8]), view).status == "lost"
    found = tracker.track(frames[9], view)
    assert (found.status, found.map_version) == ("tracked", view.version)
    assert tracker.track(frames[10], view).map_version == 0
    tracker.limit_work(TrackingWork())
    assert tracker.track(frames[11], view).map_version == view.version


def test_a_tracker_aligns_fewer_points_of_noisy_depth_if_asked():
    noisy = [with_white_noise(frame, 4e-3) for frame in room_frames()[:4]]
    tracking = replace(SMALL.tracker, depth_window_px=5, surface_points=2 * SMALL.tracker.points)
    dense, sparse = (
        replace(SMALL, tracker=tracking),
        replace(SMALL, tracker=replace(tracking, surface_points=0)),
    )
    limited, usual, expected = (Tracker(of, _store(), 0) for of in (dense, dense, sparse))
    limited.limit_work(TrackingWork(uses_surface_points=False))
    for frame in noisy:
        poses = [t.track(frame, None).T_world_cam for t in (limited, usual, expected)]
        np.testing.assert_array_equal(poses[0], poses[2])
    assert (poses[0] != poses[1]).any()


def _all_free(frame: Frame) -> MapView:
    """A map to which all space is free, as it is to one that has not seen the place."""
    layout = FieldLayout.over(SMALL.field, initial_bound(frame, SMALL.bound, 12.0))
    params = np.zeros(layout.parameter_count, np.float32)
    W1 = layout.blocks["geometry_decoder.W1"].view(params)
    W1[-SMALL.field.oneblob_width :, 0] = 10
    layout.blocks["geometry_decoder.W2"].view(params)[0, 0] = 10
    return MapView(1, kernel_layout(layout), params, SMALL.field.truncation_m)


def test_a_frame_whose_map_was_overwritten_is_tracked_again_as_if_for_the_first_time():
    frames = room_frames()[:10]
    tracker, calm = (Tracker(SMALL, _store(), 0) for _ in range(2))
    view = _all_free(frames[0])
    torn = replace(view, is_intact=lambda: False)
    expected = [calm.track(frame, view) for frame in frames]
    found = [tracker.track(frames[0], view)]
    for frame in frames[1:]:
        with pytest.raises(TornMapError, match="version 1 of the map was overwritten"):
            tracker.track(frame, torn)
        found.append(tracker.track(frame, view))
    for a, b in zip(expected, found, strict=True):
        np.testing.assert_array_equal(a.T_world_cam, b.T_world_cam)
        assert (a.keyframe, a.is_keyframe, a.status) == (b.keyframe, b.is_keyframe, b.status)


def test_a_copied_view_is_whole_while_the_map_goes_on():
    arrays = MemoryAllocator()
    layout = FieldLayout.over(SMALL.field, initial_bound(room_frames()[0], SMALL.bound, 12.0))
    parameters = FieldParameters.create(arrays, layout, seed=0)
    views = MapViews(FieldParameters(arrays, SMALL.field), CPU)
    assert views.newest() is views.copied() is None
    parameters.publish()
    in_place, own = views.newest(), views.copied()
    assert in_place is not None and own is not None
    before = own.params.copy()
    parameters.params[:] += 1.0
    for _ in range(2):
        in_place.expect_intact()
        parameters.publish()
    with pytest.raises(TornMapError):
        in_place.expect_intact()
    own.expect_intact()
    np.testing.assert_array_equal(own.params, before)
    newest = views.newest()
    assert newest is not None and newest.version == 3


def test_what_is_settled_early_changes_no_pose():
    """The service settles after it has published a pose, the library with the next frame."""
    frames = room_frames()[:30]
    eager, lazy = (Tracker(SMALL, _store(), 0) for _ in range(2))
    for frame in frames:
        first = eager.track(frame, None)
        eager.prepare_next()
        np.testing.assert_array_equal(first.T_world_cam, lazy.track(frame, None).T_world_cam)


@pytest.mark.parametrize("gap", [14, 20])
def test_after_a_gap_the_next_frame_is_tracked_where_it_is(gap):
    _, results = _tracked(_store(), [*room_frames()[:16], *room_frames()[15 + gap : 19 + gap]])
    assert all(map(_is_right, results[1:]))
