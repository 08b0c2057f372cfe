"""A camera that is lost and moves on: tracked beside the map, and joined to it where it has been before."""

from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.fragments.fragment import Fragment
from hsslam_node.frame import Frame
from hsslam_node.odometry.simulated import simulated_odometry
from hsslam_node.tracking.map_view import TornMapError
from hsslam_node.tracking.places.relocalisation import Relocalisation, SeenAgain
from hsslam_node.tracking.tracked_frame import TrackResult
from hsslam_node.tracking.tracker import Tracker
from hsslam_node.tracking.tracking_work import TrackingWork
from tests.lost_walk import (
    DARK,
    DRIFT_DEG,
    DRIFT_M,
    lost_and_joined,
    opened,
    until_it_is_copied,
    walk,
)
from tests.small_room import pose_error, with_black


def test_a_lost_camera_goes_on_in_a_fragment_that_joins_the_map():
    results, store, counts = lost_and_joined()
    _, truth = walk()
    states = [(r.status, r.fragment) for r in results]
    begun = states.index(("lost", 1))
    joined = next(k for k, r in enumerate(results) if r.joined)
    assert results[begun].frame_index >= DARK.stop
    assert set(states[begun:joined]) == {("lost", 1)}
    assert set(states[joined:]) == {("tracked", 0)}
    assert [k for k, r in enumerate(results) if r.is_carried] == [joined]
    at_join, after = (results[k].covariance for k in (joined, joined + 1))
    assert at_join is not None and after is not None
    assert 0.1 < np.trace(at_join[:3, :3]) / np.trace(after[:3, :3]) < 10
    assert len(set(counts[begun:joined])) == 1 < counts[joined] - counts[joined - 1]  # all at once
    for r in results[joined:]:
        off_m, off_deg = pose_error(results[0].T_world_cam @ truth[r.frame_index], r.T_world_cam)
        assert off_m < 0.02 and off_deg < 0.5
    for k, T in zip(store.frame_indices().tolist(), store.poses(), strict=True):
        off_m, off_deg = pose_error(results[0].T_world_cam @ truth[k], T)
        assert off_m < DRIFT_M and off_deg < DRIFT_DEG
    assert set(store.fragments().tolist()) == {0, 1}


def test_the_walk_that_tests_share_goes_on_to_the_bit_as_a_whole_walk():
    """`until_it_is_copied` loads a saved tracker; a thread or an array that it left out would show here."""
    results, _, counts = lost_and_joined()
    tracker, store, end = until_it_is_copied(before=20)
    for frame, before, count in zip(walk()[0][end:], results[end:], counts[end:], strict=True):
        result = tracker.track(frame, None)
        assert (result.status, result.keyframe, store.count) == (
            before.status,
            before.keyframe,
            count,
        )
        np.testing.assert_array_equal(result.T_world_cam, before.T_world_cam)
    assert any(r.joined for r in results[end:])


def test_keyframes_of_map_and_fragment_come_half_as_often_if_asked():
    tracker, store = opened(3.0)
    counts = []
    for frame in walk()[0]:
        tracker.limit_work(TrackingWork(keyframes_every=2))
        joined = tracker.track(frame, None).joined
        counts.append(store.count)
        if joined is not None:
            break
    results, _, usual = lost_and_joined()
    join = next(k for k, r in enumerate(results) if r.joined)
    brought, usually_brought = counts[-1] - counts[-2], usual[join] - usual[join - 1]
    assert counts[DARK.start - 1] < usual[DARK.start - 1] and brought < usually_brought


def test_frames_of_a_fragment_follow_the_keyframes_that_it_brought():
    results, store, _ = lost_and_joined()
    _, truth = walk()
    (joined,) = (r.joined for r in results if r.joined)
    for r in results:
        if r.fragment != joined.fragment:
            continue
        T_own_cam = joined.T_keyframe_own[r.keyframe] @ r.T_keyframe_cam
        T = store.pose(int(joined.keyframes[r.keyframe])) @ T_own_cam
        off_m, _ = pose_error(results[0].T_world_cam @ truth[r.frame_index], T)
        assert off_m < DRIFT_M


def test_without_the_option_the_camera_stays_lost_until_it_is_found():
    tracker, _ = opened(0.0)
    results = [tracker.track(frame, None) for frame in walk()[0][:80]]
    assert {r.fragment for r in results} == {0}
    assert results[-1].status == "lost"


def test_a_loss_before_frames_that_only_localise_does_not_count():
    tracker, _ = opened(3.0)
    frames, _ = walk()
    lost_at, again = DARK.start + 5, DARK.start + 25
    for frame in frames[:lost_at]:
        tracker.track(frame, None)
    for frame in frames[lost_at:again]:
        shown = replace(frames[DARK.start - 1], index=frame.index, stamp_ns=frame.stamp_ns)
        found = tracker.track(shown, None, localise_only=True)
    assert found.status == "tracked"
    results = ((frame.stamp_ns, tracker.track(frame, None)) for frame in frames[again:])
    begun_ns = next(stamp_ns for stamp_ns, result in results if result.fragment == 1)
    assert begun_ns - frames[again].stamp_ns >= 3e9


def test_a_clock_that_is_set_back_while_the_camera_is_lost_delays_no_fragment():
    tracker, _ = opened(3.0)
    frames, _ = walk()
    set_back, back_ns = DARK.start + 3, 5_000_000_000
    for frame in frames[:set_back]:
        tracker.track(frame, None)
    later = [replace(f, stamp_ns=f.stamp_ns - back_ns) for f in frames[set_back:]]
    results = ((frame.stamp_ns, tracker.track(frame, None)) for frame in later)
    begun_ns = next(stamp_ns for stamp_ns, result in results if result.fragment == 1)
    assert 3e9 <= begun_ns - later[0].stamp_ns < 5e9


def test_each_comparison_with_the_map_has_ended_before_a_fragment_is_copied(monkeypatch):
    """A comparison reads the index of the map's keyframes in a thread."""
    compare, begun, ended = Relocalisation.compare, [], []

    def watched(places: Relocalisation, frame: Frame) -> Future[list[SeenAgain]]:
        future = compare(places, frame)
        begun.append(future)
        result = future.result
        monkeypatch.setattr(future, "result", lambda: (ended.append(future), result())[1])
        return future

    monkeypatch.setattr(Relocalisation, "compare", watched)
    until_it_is_copied()
    assert begun and ended == begun


def test_a_fragment_does_not_join_while_odometry_bridges_what_the_camera_does_not_see():
    tracker, store, end = until_it_is_copied()
    frames, poses = walk()
    wheels = simulated_odometry(poses, 0.01, seed=1)
    covered = range(end + 1, end + 8)  # without them it would join at the third frame
    before, gap_at = store.count, None
    for k in range(end, end + 30):
        frame = replace(frames[k], odometry=wheels[k])
        result = tracker.track(with_black(frame) if k in covered else frame, None)
        if result.joined is not None:
            gap_at = k
            break
        assert (result.status, result.fragment) == ("lost", 1) and store.count == before
        assert result.is_reckoned == (k in covered)
    assert gap_at is not None and gap_at > covered.stop
    gaps = [store.gap_covariance(k).any() for k in range(before + 1, store.count)]
    assert gaps.count(True) == 1  # the way without sight
    off_m, off_deg = pose_error(result.T_world_cam, poses[gap_at])
    assert off_m < DRIFT_M and off_deg < DRIFT_DEG


def test_a_frame_that_is_lost_in_the_fragment_is_tracked_there_once_if_the_map_is_torn(monkeypatch):
    (torn, _, end), (calm, _, _) = until_it_is_copied(before=20), until_it_is_copied(before=20)
    frames = walk()[0]
    black = with_black(frames[end])
    track, torn_reads = Tracker.track, [TornMapError]

    def track_once_torn(tracker: Tracker, *args, **options) -> TrackResult:
        if tracker is torn._map and torn_reads:
            raise torn_reads.pop()
        return track(tracker, *args, **options)

    monkeypatch.setattr(Tracker, "track", track_once_torn)
    with pytest.raises(TornMapError):
        torn.track(black, None)
    assert torn.track(black, None).status == calm.track(black, None).status == "lost"
    lost = [each._fragment.tracker._motion.lost_frames for each in (torn, calm)]
    assert lost == [1, 1]


def test_a_fragment_that_ends_without_a_join_is_kept():
    """The camera is found in the map again; the next fragment begins; the camera ends."""
    kept: list[Fragment] = []
    tracker, _ = opened(0.3, kept)
    frames, _ = walk()
    black, known, there, elsewhere = -1, 0, 60, 80
    numbers, ended = [], []
    shown = [known, *8 * [there], black, *2 * [known], *8 * [there], black, *8 * [elsewhere]]
    for moment, number in zip(frames, shown, strict=False):
        frame = frames[number] if number >= 0 else with_black(frames[0])
        frame = replace(frame, index=moment.index, stamp_ns=moment.stamp_ns)
        numbers.append(tracker.track(frame, None).fragment)
        ended.append(len(kept))
    assert numbers[8] == 1 and numbers[11] == 0 and ended[8:12] == [0, 0, 1, 1]
    assert numbers[19] == 2 and numbers[-1] == 3 and ended[19] == 1 and ended[-1] == 2
    assert tracker.finish() is None
    assert [fragment.number for fragment in kept] == [1, 2, 3]
    for fragment in kept:
        assert fragment.store.kept().tolist() == [0]
