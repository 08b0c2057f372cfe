"""The camera is lost, ends or is looked for by hand while its fragment joins the map."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.fragments.fragment import Fragment
from hsslam_node.odometry.simulated import simulated_odometry
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.tracking.places.place_near import Whereabouts
from tests.lost_walk import DRIFT_DEG, DRIFT_M, until_it_is_copied, walk
from tests.small_room import pose_error, with_black


def test_a_fragment_that_is_being_copied_when_the_camera_ends_joins_the_map():
    kept: list[Fragment] = []
    tracker, store, _ = until_it_is_copied(kept)
    before = store.count
    joined = tracker.finish()
    assert joined is not None and joined.fragment == 1
    assert sorted({*joined.keyframes.tolist()}) == list(range(before, store.count))
    assert not kept


@pytest.mark.parametrize("covered", [1, 4])
def test_a_camera_that_is_lost_while_its_fragment_is_copied_goes_on_in_the_map(covered: int):
    kept: list[Fragment] = []
    tracker, store, end = until_it_is_copied(kept)
    before, (frames, truth) = store.count, walk()
    dark = [tracker.track(with_black(f), None) for f in frames[end : end + covered]]
    assert {(r.status, r.fragment) for r in dark} == {("lost", 0)}
    assert sum(r.joined is not None for r in dark) == 1 and store.count > before
    after = [tracker.track(f, None) for f in frames[end + covered : end + covered + 8]]
    assert after[-1].status == "tracked" and after[-1].fragment == 0 and not kept
    off_m, off_deg = pose_error(truth[after[-1].frame_index], after[-1].T_world_cam)
    assert off_m < DRIFT_M and off_deg < DRIFT_DEG


def test_one_lost_frame_does_not_end_the_join_of_a_fragment():
    tracker, store, end = until_it_is_copied(before=6)
    before, (frames, _) = store.count, walk()
    assert tracker._joining is not None
    lost = tracker.track(with_black(frames[end]), None)
    assert (lost.status, lost.fragment, lost.joined) == ("lost", 0, None) and store.count == before
    after = [tracker.track(f, None) for f in frames[end + 1 : end + 9]]
    states = [(r.status, r.fragment) for r in after]
    joined = next(k for k, r in enumerate(after) if r.joined)
    assert joined > 0 and states[:joined] == joined * [("lost", 1)]  # found in the fragment
    assert set(states[joined:]) == {("tracked", 0)} and store.count > before


def test_a_fragment_that_finds_too_little_room_is_kept_when_the_camera_is_lost():
    """The camera then sees nothing that map or fragment show, and the next fragment begins."""
    kept: list[Fragment] = []
    tracker, store, end = until_it_is_copied(kept, before=12)
    frames = walk()[0]
    building = SourceOptions(frames=1, synth=SynthOptions(width_px=160, height_px=120))
    (elsewhere,) = open_source("synth:apartment", building).frames()
    store.room.allow(store.count)
    while tracker._joining is None:
        tracker.track(frames[end], None)
        end += 1
    before, numbers = store.count, []
    for frame in frames[end : end + 25]:
        shown = replace(elsewhere, index=frame.index, stamp_ns=frame.stamp_ns)
        numbers.append(tracker.track(shown, None).fragment)
    assert set(numbers) == {0, 2} and [fragment.number for fragment in kept] == [1]
    assert store.count == before and not store.room.wanted
    assert len(kept[0].store.kept()) > 10


def test_a_search_by_hand_does_not_end_a_join_whose_place_is_just_found():
    """The comparison that runs beside has found the place of the fragment; no frame knows of it yet."""
    kept: list[Fragment] = []
    tracker, _, end = until_it_is_copied(kept, before=9)
    frames, truth = walk()
    assert tracker._joining is None
    near = Whereabouts(truth[end], np.array([0.0, -1.0, 0.0]))
    assert tracker.find_near(frames[end], None, near) is None
    results = [tracker.track(frame, None) for frame in frames[end : end + 10]]
    assert any(r.joined for r in results) and not kept


def test_a_covered_lens_right_after_a_join_is_bridged_by_odometry():
    tracker, _, end = until_it_is_copied()
    frames, truth = walk()
    wheels = simulated_odometry(truth, 0.01, seed=1)
    joined, k = None, end
    while joined is None:
        joined = tracker.track(replace(frames[k], odometry=wheels[k]), None).joined
        k += 1
    dark = tracker.track(with_black(replace(frames[k], odometry=wheels[k])), None)
    assert (dark.status, dark.fragment) == ("dead_reckoned", 0)
    off_m, off_deg = pose_error(dark.T_world_cam, truth[k])
    assert off_m < DRIFT_M and off_deg < DRIFT_DEG
    assert dark.covariance is not None and np.trace(dark.covariance[:3, :3]) > 3 * 0.02**2
