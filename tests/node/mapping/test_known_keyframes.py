"""After a run that continues a saved map, its keyframes retire if they show only what the map shows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.config import KeyframeConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.keyframe_selection import KeyframeSelection
from hsslam_node.mapping.view_cells import view_cells
from tests.small_room import room_frames, room_poses

Views = Sequence[tuple[Frame, np.ndarray]]
_WAY = [(room_frames()[k], room_poses()[k]) for k in range(0, 40, 4)]
_ENOUGH = 6  # views that clear or mark a place
_LEFT, _RIGHT = np.s_[30:60, 5:35], np.s_[30:60, 125:155]  # 5 % of the image each


def _continued(saved: Views, own: Views) -> tuple[KeyframeStore, list[int]]:
    """A store with the keyframes of a saved map and of a run that has ended, and which of these stay."""
    first = saved[0][0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 128)
    for frame, T in saved:
        store.append(frame, T)
    store.mark_inherited()
    for frame, T in own:
        store.append(frame, T)
    selection, left = KeyframeSelection(KeyframeConfig(), 12.0), []
    while not left or left[-1]:
        left.append(selection.select_last(store))
    assert left == sorted(left, reverse=True)
    kept = store.kept()
    assert kept[: len(saved)].tolist() == list(range(len(saved)))
    return store, (kept[len(saved) :] - len(saved)).tolist()


def test_of_views_that_a_saved_map_shows_the_newest_stays():
    store, stay = _continued(_WAY, _WAY)
    assert stay == [len(_WAY) - 1]
    poses = store.poses()
    np.testing.assert_allclose(poses[len(_WAY) :], poses[: len(_WAY)], atol=1e-9)


def test_all_that_a_saved_map_does_not_show_stays():
    aside = se3_exp(np.array([0, 0, 0, 0, np.pi, 0]))
    assert len(_continued(_WAY, [(frame, aside @ T) for frame, T in _WAY])[1]) == len(_WAY)


def test_without_a_saved_map_none_retires():
    store, _ = _continued(_WAY, [])
    selection = KeyframeSelection(KeyframeConfig(), 12.0)
    assert not selection.select_last(store) and len(store.kept()) == len(_WAY)
    store.mark_inherited()  # and no keyframe of this run
    assert not selection.select_last(store) and len(store.kept()) == len(_WAY)


@pytest.mark.parametrize("is_brought", [True, False])
def test_where_a_small_thing_was_brought_or_carried_away_new_keyframes_stay(is_brought: bool):
    boxes = [(_with_a_box(frame), T) for frame, T in _WAY]
    saved, own = (_WAY, boxes) if is_brought else (boxes, _WAY)
    assert len(_continued(saved, own)[1]) >= _ENOUGH


def test_after_a_thing_that_came_and_went_in_one_run_keyframes_without_it_stay():
    boxes = [(_with_a_box(frame), T) for frame, T in _WAY]
    stay = _continued(_WAY, [*_WAY, *boxes, *_WAY])[1]
    n = len(_WAY)
    passes = [sum(first <= k < first + n for k in stay) for first in (0, n, 2 * n)]
    assert passes[0] == 0 and min(passes[1:]) >= _ENOUGH, stay


def test_one_keyframe_stays_for_new_surface_that_fills_a_small_part_of_many_views():
    """Two places that the map lacks, each in view of several keyframes, but not of the newest."""
    frame, T = _WAY[0]
    known = _without(frame, _LEFT, _RIGHT)
    left, right = _without(frame, _RIGHT), _without(frame, _LEFT)
    new = [~np.isin(view_cells(f, T, 12.0), view_cells(known, T, 12.0)) for f in (left, right)]
    assert all(0.02 < np.mean(is_new) < 0.1 for is_new in new)
    views = [known, left, left, right, left, right, known]
    store, stay = _continued([(known, T)], [(f, T) for f in views])
    assert stay == [1, 3, 6]
    shown = [view_cells(store.frame(int(k)), T, 12.0) for k in store.kept()]
    assert np.isin(view_cells(frame, T, 12.0), np.concatenate(shown)).all()


def _with_a_box(frame: Frame) -> Frame:
    """The frame with a box 0.5 m before the surface, on 1.7 % of the image."""
    depth_raw = frame.depth_raw.copy()
    depth_raw[52:67, 69:91] -= np.uint16(0.5 * frame.depth_units_per_m)
    return replace(frame, depth_raw=depth_raw)


def _without(frame: Frame, *parts: tuple[slice, slice]) -> Frame:
    """The frame without measurements in these parts of the image."""
    depth_raw = frame.depth_raw.copy()
    for part in parts:
        depth_raw[part] = 0
    return replace(frame, depth_raw=depth_raw)
