"""How many keyframes are allowed follows the budget, the system's memory and the other arrays."""

import os
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.memory_budget import MemoryBudget

CAMERA = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)
BYTES = 5 * 640 * 480


@pytest.fixture
def arena(tmp_path: Path) -> Arena:
    return Arena(tmp_path)


@pytest.fixture(autouse=True)
def shared_memory_bytes(monkeypatch) -> list[int]:
    """Bytes in all and free, of the system's shared memory: plenty, whatever the disk of the test has."""
    real, said = os.statvfs, [64_000_000_000, 32_000_000_000]

    def limited(folder: Path) -> os.statvfs_result:
        of = real(folder)
        total, free = (n // of.f_frsize for n in said)
        return os.statvfs_result((*of[:2], total, free, free, *of[5:]))

    monkeypatch.setattr(os, "statvfs", limited)
    return said


@pytest.fixture
def nearly_full(shared_memory_bytes) -> None:
    """Of 64 MB of shared memory 16 are free."""
    shared_memory_bytes[:] = 64_000_000, 16_000_000


def _store(arena: Arena, count: int, capacity: int = 1000) -> KeyframeStore:
    store = KeyframeStore.create(arena, CAMERA, 1000.0, capacity)
    for k in range(count):
        store.append(Frame(k, k, CAMERA, *_pixels(), 1000.0), np.eye(4))
    return store


def _pixels() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), np.uint16)


def test_what_other_arrays_take_is_not_for_keyframes(arena):
    store = _store(arena, 3)
    assert MemoryBudget(arena.folder, 0.2).apply(store) is None
    before = store.room.most_kept
    assert 0.8 * 0.19e9 / BYTES < before <= 0.19e9 / BYTES
    arena.create("field", (50_000_000,), np.uint8)
    MemoryBudget(arena.folder, 0.2).apply(store)
    assert before - store.room.most_kept == pytest.approx(50e6 / BYTES, abs=1)


def test_what_the_run_has_beside_its_arena_is_not_for_keyframes_either(arena):
    store = _store(arena, 3)
    MemoryBudget(arena.folder, 0.2).apply(store)
    before = store.room.most_kept
    (arena.folder / "note").write_bytes(bytes(10_000_000))  # no array
    MemoryBudget(arena.folder, 0.2, lambda: 20_000_000).apply(store)
    assert before - store.room.most_kept == pytest.approx(30e6 / BYTES, abs=1)


def test_scarcity_is_told_once(arena):
    store = _store(arena, 16)
    budget = MemoryBudget(arena.folder, 0.025)  # of which pose rows and table take a little
    told = budget.apply(store)
    assert told is not None and "--memory-gb 0.025" in told and "keeps 16 keyframes" in told
    assert budget.apply(store) is None and store.room.most_kept <= 16


def test_a_limit_below_what_the_map_takes_is_told_once(arena):
    """The first keyframes stay, whatever they take."""
    store = _store(arena, 3)
    arena.create("field", (50_000_000,), np.uint8)
    budget = MemoryBudget(arena.folder, 0.05)
    told = budget.apply(store)
    assert told is not None and "--memory-gb 0.05 is too little" in told
    assert "leaves room for 0 keyframes: the run keeps 12 and exceeds the limit" in told
    assert budget.apply(store) is None and store.room.most_kept == 12


def test_capacity_counts_as_well(arena):
    store = _store(arena, 9, capacity=12)
    told = MemoryBudget(arena.folder, 2.0).apply(store)
    assert store.room.most_kept == 12 and told is not None and "keyframes.capacity" in told


def test_so_does_what_the_system_has_left(arena, nearly_full):
    store = _store(arena, 3)
    MemoryBudget(arena.folder, 2.0).apply(store)
    assert store.room.most_kept == (8 * BYTES + 16e6 - 6.4e6) // BYTES


def test_what_was_given_back_to_the_system_counts_once(arena, nearly_full):
    """The system counts it as free; the files are as long as before."""
    store = _store(arena, 40)
    for k in range(1, 31):
        store.retire(k, 0)
    for k in range(40, 56):
        store.append(Frame(k, k, CAMERA, *_pixels(), 1000.0), np.eye(4))
    MemoryBudget(arena.folder, 2.0).apply(store)
    least = (len(store.kept()) * BYTES + 16e6 - 6.4e6) // BYTES
    assert least <= store.room.most_kept <= least + 8  # slots that stay ready
