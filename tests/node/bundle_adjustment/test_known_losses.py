"""Active selection knows the loss of every keyframe, of hundreds as well."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.bundle_adjustment.global_ba import GlobalBundleAdjustment
from hsslam_node.config import BundleAdjustmentConfig, SlamConfig
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.mapper import Mapper
from tests.small_room import SMALL, MappedRoom, displaced, mapped_room

BA = BundleAdjustmentConfig(
    rays=300, iterations=1, loss_threshold=1e-6, probe_rays=100, probe_keyframes=10
)


def _config(**ba) -> SlamConfig:
    return replace(SMALL, ba=replace(BA, **ba), mapper=replace(SMALL.mapper, rays=400))


def _long_run(count: int, config: SlamConfig) -> MappedRoom:
    """The map of ten keyframes, which were seen again and again."""
    room = mapped_room(config)
    one = room.store.frame(0)
    store = KeyframeStore.create(MemoryAllocator(), one.camera, one.depth_units_per_m, 1024)
    for k in range(count):
        store.append(room.store.frame(k % 10), room.store.pose(k % 10))
    return replace(room, store=store)


def _goes_on(room: MappedRoom, seed: int) -> int:
    """Four more keyframes, one of them at a wrong pose: its id."""
    store = room.store
    bad = store.count + seed % 4
    for k in range(store.count, store.count + 4):
        T = store.pose(k % 10)
        store.append(store.frame(k % 10), displaced(T, 0.03, 1.5, seed) if k == bad else T)
    return bad


def _noted(store: KeyframeStore) -> np.ndarray:
    """Ids of the keyframes whose loss is known."""
    kept = store.kept()
    return kept[~np.isnan(store.losses(kept))]


def test_of_hundreds_of_keyframes_the_new_one_at_a_wrong_pose_is_refined_at_once():
    room = _long_run(300, _config())
    ba = GlobalBundleAdjustment(room.config, room.parameters, 0)
    ba.round(room.store)
    assert len(_noted(room.store)) == 300
    wrong = set()
    for seed in range(6):
        wrong.add(_goes_on(room, seed))
        assert ba.is_due(room.store)
        report = ba.round(room.store)
        assert wrong <= set(report.keyframes.tolist())  # no pose is written back: they stay wrong
        assert len(_noted(room.store)) == room.store.count


def test_without_batch_losses_few_of_hundreds_are_known():
    room = _long_run(300, _config(batch_losses=False))
    ba = GlobalBundleAdjustment(room.config, room.parameters, 0)
    ba.round(room.store)
    found = 0
    for seed in range(6):
        bad = _goes_on(room, seed)
        found += bad in ba.round(room.store).keyframes
    assert found <= 2 and len(_noted(room.store)) == 0


def test_mapping_notes_the_losses_of_its_window():
    room = _long_run(300, _config())
    mapper = Mapper(room.config, room.parameters, 0)
    report = mapper.iterate(room.store)
    noted = _noted(room.store)
    assert len(noted) == room.config.mapper.window_keyframes and {298, 299} <= set(noted)
    assert sorted(room.store.losses(noted)) == sorted(report.keyframe_loss)
    mapper.refine_sparse(room.store)  # its rays are not of the whole images
    assert len(_noted(room.store)) == len(noted)


def test_what_mapping_has_noted_counts_in_the_next_round():
    room = _long_run(40, _config(top_keyframes=3))
    room.store.note_losses(np.arange(40), np.full(40, 1e-3))
    room.store.note_losses(np.array([7, 21, 33]), np.array([5.0, 7.0, 6.0]))
    ba = GlobalBundleAdjustment(_config(top_keyframes=3, probe_keyframes=1), room.parameters, 0)
    chosen = ba.round(room.store).keyframes.tolist()
    assert len({7, 21, 33} & set(chosen)) >= 2  # one of them may just have been measured again


@pytest.mark.parametrize(
    "ba", [{"batch_losses": False}, {"enabled": False}, {"selection": "uniform"}]
)
def test_nobody_notes_what_nobody_asks_for(ba):
    room = _long_run(12, _config(**ba))
    Mapper(room.config, room.parameters, 0).iterate(room.store)
    GlobalBundleAdjustment(room.config, room.parameters, 0)
    assert len(_noted(room.store)) == 0
