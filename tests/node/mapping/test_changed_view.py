"""Small things count that are brought or carried away, and the newest view of a place decides."""

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.changed_view import has_changed

_CAMERA = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
_WALL_M = 4.0


def _store(*views: tuple[float, float, float]) -> KeyframeStore:
    """Keyframes before a wall with a box in front of it: its side, m, its distance, m, and how far to the
    right of the first camera the camera stands, m."""
    store = KeyframeStore.create(MemoryAllocator(), _CAMERA, 1000.0, len(views))
    for k, (side_m, box_m, x_m) in enumerate(views):
        depth_raw = np.full((480, 640), 1000 * _WALL_M, np.uint16)
        half_px, u = (int(_CAMERA.fx / box_m * m) for m in (side_m / 2, -x_m))
        depth_raw[240 - half_px : 240 + half_px, 320 + u - half_px : 320 + u + half_px] = (
            1000 * box_m
        )
        T = np.eye(4)
        T[0, 3] = x_m
        store.append(Frame(k, k, _CAMERA, np.zeros((480, 640, 3), np.uint8), depth_raw, 1000.0), T)
    return store


@pytest.mark.parametrize(("side_m", "box_m"), [(0.15, 1.0), (0.2, 2.0), (0.3, 3.0)])
def test_a_box_that_was_brought_or_carried_away_is_a_change(side_m: float, box_m: float):
    store = _store((0.0, box_m, 0.0), (side_m, box_m, 0.05), (side_m, box_m, 0.0))
    assert has_changed(store, 1, np.array([0])) and has_changed(store, 0, np.array([1]))
    assert not has_changed(store, 1, np.array([2])) and not has_changed(store, 2, np.array([1]))


def test_the_newest_views_of_a_place_decide():
    box, none = (0.8, 2.0), (0.0, 2.0)
    gone = [(*none, 0.2 + 0.01 * k) for k in range(6)]  # later, and from farther away
    store = _store((*box, 0.0), *gone, (*box, 0.02), (*none, 0.02))
    back, still_gone = 7, 8
    assert has_changed(store, back, np.arange(7))
    assert not has_changed(store, still_gone, np.arange(7))


def test_a_change_counts_until_six_views_show_it():
    box, none = (0.8, 2.0), (0.0, 2.0)
    store = _store((*none, 0.0), *[(*box, 0.01 * k) for k in range(6)], (*box, 0.02))
    assert has_changed(store, 7, np.arange(6)) and not has_changed(store, 7, np.arange(7))


def test_what_the_newest_views_do_not_see_an_older_one_decides():
    box, none = (0.5, 2.0), (0.0, 2.0)
    newest = [(*none, -1.45 - 0.01 * k) for k in range(6)]
    store = _store((*none, -0.9), *newest, (*box, -0.95))
    assert not has_changed(store, 7, np.arange(1, 7))
    assert has_changed(store, 7, np.arange(7))


def test_later_views_of_other_places_are_not_looked_at(monkeypatch):
    box, none = (0.8, 2.0), (0.0, 2.0)
    store = _store((*none, 0.0), (*box, 0.05), *[(*none, 5.0 + k) for k in range(40)])
    looked, pixels = [], store.pixels

    def counted(k: int) -> tuple[np.ndarray, np.ndarray]:
        looked.append(k)
        return pixels(k)

    monkeypatch.setattr(store, "pixels", counted)
    assert has_changed(store, 1, np.array([0]), np.arange(2, 42))
    assert set(looked) == {0, 1}


def test_a_change_that_the_next_view_undoes_is_none():
    box, none = (0.8, 2.0), (0.0, 2.0)
    store = _store((*none, 0.0), (*box, 0.05), (*none, 0.0), (*box, 0.0))
    assert not has_changed(store, 1, np.array([0]), np.array([2]))
    assert has_changed(store, 1, np.array([0]), np.array([2, 3]))
    assert not has_changed(store, 2, np.array([1]), np.array([3]))  # back again
