from pathlib import Path

import numpy as np
import pytest

from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_services.governor.levels import LEVELS
from hsslam_services.governor.mapping_backlog import MappingBacklog
from hsslam_services.governor.shared_level import SharedLevel
from tests.small_room import room_frames


@pytest.fixture
def level(tmp_path: Path) -> SharedLevel:
    SharedLevel.create(tmp_path)
    return SharedLevel(tmp_path)


@pytest.fixture
def store() -> KeyframeStore:
    frame = room_frames()[0]
    return KeyframeStore.create(MemoryAllocator(), frame.camera, frame.depth_units_per_m, 32)


def _append(store: KeyframeStore, count: int, fragment: int = 0) -> None:
    for frame in room_frames()[:count]:
        store.append(frame, np.eye(4), fragment=fragment)


def _all(backlog: MappingBacklog, store: KeyframeStore) -> list[int]:
    """Counts of iterations, one slice after the other, until none is due."""
    slices = []
    while backlog.take(store):
        slices.append(backlog.next_count())
        backlog.done(slices[-1])
    return slices


def test_each_keyframe_asks_for_its_iterations_once(level, store):
    backlog = MappingBacklog(4, level, has_limit=False)
    _append(store, 3)
    backlog.skip_to(1)
    assert _all(backlog, store) == [4, 4]
    assert _all(backlog, store) == []


def test_a_load_level_asks_for_fewer(level, store):
    level.number = next(k for k, one in enumerate(LEVELS) if one.iterations == 0.5)
    backlog = MappingBacklog(5, level, has_limit=False)
    _append(store, 3)
    assert sum(_all(backlog, store)) == 7  # of 7.5
    _append(store, 1)
    assert sum(_all(backlog, store)) == 3  # with the half that was left


@pytest.mark.parametrize(("has_limit", "expected"), [(True, 24), (False, 40)])
def test_in_real_time_at_most_six_keyframes_wait(level, store, has_limit, expected):
    backlog = MappingBacklog(4, level, has_limit=has_limit)
    _append(store, 10)
    assert sum(_all(backlog, store)) == expected


def test_all_keyframes_of_a_fragment_that_joins_wait(level, store):
    backlog = MappingBacklog(4, level, has_limit=True)
    _append(store, 2)
    assert sum(_all(backlog, store)) == 8
    _append(store, 12, fragment=1)
    assert store.joined_since(2) == 12
    assert sum(_all(backlog, store)) == 48
    _append(store, 10, fragment=1)  # by the camera, after the join
    assert store.joined_since(14) == 0
    assert sum(_all(backlog, store)) == 24
