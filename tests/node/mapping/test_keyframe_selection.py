"""Keyframes stay for what they show that others do not: view, surface and light."""

from dataclasses import replace

import numpy as np

from hsslam_node.config import KeyframeConfig
from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.states import OCCUPIED
from hsslam_node.distance.voxel_grid import VOXEL_M, VoxelGrid
from hsslam_node.frame import Frame
from hsslam_node.geometry.projection import pixel_rays
from hsslam_node.geometry.se3 import inverse, se3_exp, transformed
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.cell_counts import CellCounts
from hsslam_node.mapping.keyframe_selection import KeyframeSelection
from hsslam_node.mapping.view_cells import view_cells
from tests.small_room import room_frames, room_poses

CONFIG = KeyframeConfig(recent=4)
VIEWS = range(0, 40, 4)
_RADIUS_M = 0.1  # of a ball


class Run:
    """A store that is filled as by a tracker and thinned as by a mapper."""

    def __init__(self, config: KeyframeConfig = CONFIG, capacity: int = 128) -> None:
        first = room_frames()[0]
        self.arrays = MemoryAllocator()
        self.store = KeyframeStore.create(
            self.arrays, first.camera, first.depth_units_per_m, capacity
        )
        self.selection = KeyframeSelection(config, 12.0)
        self.most = 0

    def see(self, frame: Frame, T: np.ndarray) -> None:
        if self.store.has_room():
            self.store.append(frame, T)
        self.most = max(self.most, len(self.store.kept()))
        self.selection.select(self.store)

    def go(self, views=VIEWS) -> None:
        for k in views:
            self.see(room_frames()[k], room_poses()[k])


def test_the_first_time_everything_stays_and_later_nothing_does():
    run = Run()
    run.go()
    assert len(run.store.kept()) == len(VIEWS)
    for _ in range(5):
        run.go()
    settled = len(run.store.kept())
    assert settled < 5 * len(VIEWS)
    for _ in range(2):
        run.go()
    kept = run.store.kept()
    assert len(kept) <= settled + 2 and run.store.count == 8 * len(VIEWS)
    assert kept[0] == 0 and kept[-4:].tolist() == list(range(run.store.count - 4, run.store.count))


def test_a_retired_keyframe_hangs_on_one_that_stands_where_it_stood():
    run = Run()
    for _ in range(6):
        run.go()
    store, moved = run.store, se3_exp(np.array([0.5, 0, 0, 0, 0, 0]))
    kept = store.kept()
    before = store.poses()
    store.correct_poses(kept[kept < 10], moved @ before[kept[kept < 10]])
    retired = np.setdiff1d(np.arange(store.count), kept)
    shift = store.poses()[retired] - before[retired]
    assert len(retired) > 10 and np.allclose(shift[:, 0, 3], 0.5, atol=0.2)


def test_another_light_and_another_side_are_new():
    run = Run()
    for _ in range(5):
        run.go()
    before = len(run.store.kept())
    dark = [replace(f, color=(f.color // 3).astype(np.uint8)) for f in room_frames()]
    for k in VIEWS:
        run.see(dark[k], room_poses()[k])
    assert len(run.store.kept()) >= before + len(VIEWS) - 4
    before = len(run.store.kept())
    turned = se3_exp(np.array([0, 0, 0, 0, np.pi, 0]))
    for k in VIEWS:
        run.see(room_frames()[k], turned @ room_poses()[k])
    assert len(run.store.kept()) >= before + len(VIEWS) - 4


def _with_a_ball(frame: Frame, T: np.ndarray, place_m: np.ndarray) -> Frame:
    """The frame with a ball of 20 cm at a place [3] m in the world."""
    v, u = np.indices(frame.depth_raw.shape)
    rays = pixel_rays(u, v, frame.camera)  # [H, W, 3], per metre of depth
    centre, length2 = transformed(inverse(T), place_m[None])[0], np.sum(rays**2, axis=-1)
    along = rays @ centre / length2
    in_half2 = (
        along**2 - (centre @ centre - _RADIUS_M**2) / length2
    )  # half the way through, squared
    depth_m = np.where(in_half2 > 0, along - np.sqrt(np.maximum(in_half2, 0)), np.inf)
    shown_m = np.minimum(depth_m, frame.depth_m())
    return replace(frame, depth_raw=np.round(shown_m * frame.depth_units_per_m).astype(np.uint16))


def _ahead(T: np.ndarray, aside_m: float = 0.0) -> np.ndarray:
    """A place [3] m in the world, 1.2 m in front of a camera."""
    return transformed(T, np.array([[aside_m, 0.0, 1.2]]))[0]


def _states_at(store: KeyframeStore, place_m: np.ndarray) -> np.ndarray:
    """What the keyframes that are kept say, one after the other, of the 2 x 2 x 2 voxels about a place."""
    occupancy = Occupancy(VoxelGrid.around(place_m, (2 * VOXEL_M,) * 3, VOXEL_M))
    for k in store.kept().tolist():
        frame = store.frame(k)
        occupancy.observe(frame.depth_m(), frame.camera, store.pose(k))
    return occupancy.states()


def test_of_views_of_a_thing_that_was_brought_enough_stay():
    run = Run()
    for _ in range(6):
        run.go()
    place_m, known = _ahead(room_poses()[20]), run.store.count
    for _ in range(6):
        for k in VIEWS:
            T = room_poses()[k]
            run.see(_with_a_ball(room_frames()[k], T, place_m), T)
    stayed = run.store.kept()[: -CONFIG.recent]
    assert 6 <= np.sum(stayed >= known) <= 30, stayed
    front_m = place_m - _RADIUS_M * room_poses()[20][:3, 2]
    assert OCCUPIED in _states_at(run.store, front_m)


def test_what_passes_by_leaves_few_keyframes():
    """A ball in every other view, each time on the other side from where it was four views before."""
    run = Run()
    for _ in range(6):
        run.go()
    before = len(run.store.kept())
    for n, k in enumerate(6 * [*VIEWS]):
        frame, T = room_frames()[k], room_poses()[k]
        aside_m = 0.35 if n // 4 % 2 else -0.35
        run.see(_with_a_ball(frame, T, _ahead(T, aside_m)) if n % 2 else frame, T)
    assert len(run.store.kept()) <= before + 24  # of 60


def test_a_door_that_opens_and_closes_leaves_no_more_keyframes_each_time():
    """A ball that is there and gone in turns; at the end it is there."""
    run, place_m, kept = Run(capacity=512), _ahead(room_poses()[20]), []
    for turn in range(12):
        for _ in range(2):
            for k in VIEWS:
                T = room_poses()[k]
                is_there = turn % 2 == 1
                frame = room_frames()[k]
                run.see(_with_a_ball(frame, T, place_m) if is_there else frame, T)
        kept.append(len(run.store.kept()))
    assert kept[11] <= kept[5] + 4, kept
    front_m = place_m - _RADIUS_M * room_poses()[20][:3, 2]
    assert OCCUPIED in _states_at(run.store, front_m)


def test_a_full_store_gives_up_what_is_most_redundant_and_never_ends():
    run = Run(capacity=12)
    for _ in range(5):
        run.go()
    assert run.store.count == 50 and run.most <= 12 and run.store.room.refused == 0
    assert run.store.kept()[0] == 0
    spread = np.ptp(run.store.frame_indices()[run.store.kept()])
    assert spread >= 28  # of 36: the kept ones are not all of one place


def test_room_is_made_without_a_new_keyframe():
    run = Run()
    run.go()
    run.store.room.allow(6)  # other arrays have grown
    assert len(run.store.kept()) == len(VIEWS) and not run.store.has_room()
    assert run.selection.select(run.store) >= 5
    assert len(run.store.kept()) <= 5 and run.store.has_room()


def test_a_restarted_mapper_decides_alike():
    run = Run()
    for _ in range(6):
        run.go()
    settled = len(run.store.kept())
    run.selection = KeyframeSelection(CONFIG, 12.0)
    for _ in range(2):
        run.go()
    assert abs(len(run.store.kept()) - settled) <= 2


def test_a_restarted_mapper_near_the_memory_limit_judges_none_anew():
    run = Run()
    for turn in (0.0, 1.6, 3.1):
        T = se3_exp(np.array([0, 0, 0, 0, turn, 0]))
        for k in (*VIEWS, *VIEWS, *VIEWS):  # as long as there is room, several show the same
            run.see(room_frames()[k], T @ room_poses()[k])
    kept = run.store.kept()
    run.store.room.allow(len(kept) + 9)  # one more than those that are left free
    run.selection = KeyframeSelection(CONFIG, 12.0)
    assert len(kept) > 50 and not any(run.selection.select(run.store) for _ in range(8))
    for _ in range(4):  # those that come are judged
        run.see(room_frames()[0], room_poses()[0])
        run.selection.select(run.store)
    assert len(run.store.kept()) < len(kept) + 4


def test_after_a_correction_keyframes_count_where_they_stand():
    run = Run()
    for _ in range(6):
        run.go()
    settled = len(run.store.kept())
    aside = se3_exp(np.array([5.0, 0, 0, 0, 0, 0]))
    run.store.correct_poses(np.arange(run.store.count), aside @ run.store.poses())
    for _ in range(8):
        run.selection.select(run.store)
    for k in VIEWS:
        run.see(room_frames()[k], aside @ room_poses()[k])
    assert len(run.store.kept()) <= settled + 2


def test_keyframes_of_a_saved_map_stay():
    run = Run()
    frame, T = room_frames()[0], room_poses()[0]
    for _ in range(8):
        run.store.append(frame, T)
    run.store.mark_inherited()
    run.go()
    run.go()
    assert set(range(8)) <= set(run.store.kept().tolist())


def test_a_saved_map_that_is_too_large_loses_no_part_as_a_whole():
    run = Run()
    for frame, T in zip(room_frames(), room_poses(), strict=True):
        run.store.append(frame, T)
    run.store.mark_inherited()
    run.store.room.allow(len(room_frames()) // 2)
    while not run.store.has_room():
        assert run.selection.select(run.store)
    kept = run.store.kept()
    assert kept[0] == 0 and np.diff(kept).max() <= 12


def test_cells_are_those_of_surface_side_distance_and_light():
    frame, T = room_frames()[0], room_poses()[0]
    cells = view_cells(frame, T, 12.0)
    assert len(cells) > 300 and (np.diff(cells) > 0).all()
    near = T @ se3_exp(np.array([0.01, 0, 0, 0, 0, 0]))
    assert np.isin(view_cells(frame, near, 12.0), cells).mean() > 0.7
    far = T @ se3_exp(np.array([5.0, 0, 0, 0, 0, 0]))
    assert np.isin(view_cells(frame, far, 12.0), cells).mean() < 0.1
    hole = replace(frame, depth_raw=np.zeros_like(frame.depth_raw))
    assert len(view_cells(hole, T, 12.0)) == 0


def test_counts_are_those_of_a_dictionary_but_for_few():
    rng = np.random.default_rng(0)
    counts, truth = CellCounts(), {}
    shown = [np.unique(rng.integers(0, 50_000, 2000) << 33) for _ in range(80)]
    for cells in shown:
        counts.add(counts.places(cells), 1)
        truth |= {c: truth.get(c, 0) + 1 for c in cells.tolist()}
    cells = np.array(list(truth))
    wrong = counts.of(counts.places(cells)) - np.array(list(truth.values()))
    assert (wrong >= 0).all() and (wrong > 0).mean() < 0.01
    for cells in shown:
        counts.add(counts.places(cells), -1)
    assert not counts.of(counts.places(np.array(list(truth)))).any()
