"""Thinned keyframes give their memory back to the system, in all processes, and new ones get it again."""

import subprocess
import sys
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.shared_pages import held_bytes

CAMERA = Camera(161, 121, 150.0, 150.0, 80.0, 60.0)  # slots that begin and end within pages
READY = 8  # slots that keep their memory


def _frame(k: int) -> Frame:
    color = np.full((CAMERA.height_px, CAMERA.width_px, 3), 1 + k % 250, np.uint8)
    return Frame(k, k, CAMERA, color, np.full(color.shape[:2], 1 + k, np.uint16), 1000.0)


def _store(arena: Arena, count: int, capacity: int = 256) -> KeyframeStore:
    store = KeyframeStore.create(arena, CAMERA, 1000.0, capacity)
    for k in range(count):
        store.append(_frame(k), np.eye(4))
    return store


def _held(arena: Arena) -> int:
    files = (arena.folder.glob(f"keyframe_{kind}.*.bin") for kind in ("color", "depth"))
    return held_bytes(path.stat() for path in chain(*files))


def _expect_whole(store: KeyframeStore) -> None:
    for k in store.kept().tolist():
        frame = store.frame(k)
        assert (frame.depth_raw == 1 + k).all() and (frame.color == 1 + k % 250).all()


def test_thinned_keyframes_give_their_memory_back_and_new_ones_get_it(tmp_path: Path):
    arena = Arena(tmp_path)
    store = _store(arena, 80)
    full = _held(arena)
    assert full >= 80 * store.pixel_bytes
    for k in range(1, 61):
        store.retire(k, 0)
    for k in range(80, 106):  # none of the slots has rested when the first of them come
        store.append(_frame(k), np.eye(4))
    kept = len(store.kept()) * store.pixel_bytes
    pages = 2 * 2 * 4096 * 80  # at both ends of a slot
    assert kept <= _held(arena) <= kept + READY * store.pixel_bytes + pages < full
    _expect_whole(KeyframeStore(arena))
    for k in range(106, 180):  # more than there ever were
        store.append(_frame(k), np.eye(4))
    assert len(store.kept()) == 120 and _held(arena) >= 120 * store.pixel_bytes
    _expect_whole(KeyframeStore(arena))


def test_no_slot_stays_ready_if_fewer_may_have_memory(tmp_path: Path):
    store = _store(Arena(tmp_path), 40)
    store.room.allow(22)
    for k in range(1, 31):
        store.retire(k, 0)
    for k in range(40, 60):
        store.append(_frame(k), np.eye(4))
        if k < 48:  # none has rested: memory of the retired ones is used again
            continue
        store.retire(k - 1, 0)
    assert len(store.kept()) <= 22
    assert _held(Arena(tmp_path)) <= (22 + 8) * store.pixel_bytes  # and those that rest


def test_another_process_sees_that_the_keyframe_is_gone(tmp_path: Path):
    arena = Arena(tmp_path)
    store = _store(arena, 40)
    code = (
        "import sys; from pathlib import Path\n"
        "from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError\n"
        "from hsslam_services.arena.arena import Arena\n"
        "store = KeyframeStore(Arena(Path(sys.argv[1])))\n"
        "color, depth = store.pixels(20)\n"
        "print(depth.max(), flush=True); sys.stdin.readline()\n"
        "try: store.frame(20)\n"
        "except RetiredKeyframeError: print('retired', color[60, 80].max(), depth[60, 80])\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as reader:
        assert reader.stdin is not None and reader.stdout is not None
        assert reader.stdout.readline() == "21\n"
        for k in range(30, 4, -1):
            store.retire(k, 0)
        for k in range(40, 60):
            store.append(_frame(k), np.eye(4))
        reader.stdin.write("\n")
        reader.stdin.flush()
        assert reader.stdout.readline() == "retired 0 0\n"


def test_a_tracker_that_died_between_mark_and_memory_is_followed_by_another(tmp_path: Path):
    arena = Arena(tmp_path)
    store = _store(arena, 16)
    store.retire(3, 0)
    arena.open("keyframe_slots")[3] = -np.iinfo(np.int64).max  # marked, its pages are there
    successor = _store(arena, 0)
    successor.append(_frame(16), np.eye(4))
    assert arena.open("keyframe_slots")[3] == 17
    _expect_whole(successor)


def test_a_dropped_slot_without_memory_for_it_is_no_slot(tmp_path: Path, monkeypatch):
    store = _store(Arena(tmp_path), 32)
    for k in range(1, 31):
        store.retire(k, 0)
    for k in range(32, 44):
        store.append(_frame(k), np.eye(4))

    def full(self: Arena, name: str, row: int) -> None:
        raise OutOfMemoryError(f"array {name}: full")

    monkeypatch.setattr(Arena, "reserve_row", full)
    with pytest.raises(OutOfMemoryError, match="keyframe_color"):
        for k in range(44, 80):
            store.append(_frame(k), np.eye(4))
    _expect_whole(store)
