"""A fragment and a map that has room for its keyframes, or too little."""

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.joining import Joining
from hsslam_node.geometry.fragment_place import FragmentPlace
from hsslam_node.geometry.se3 import inverse, se3_exp, so3_exp, so3_log
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.keyframe_selection import KeyframeSelection
from hsslam_node.tracking.tracked_frame import JoinedFragment
from tests.small_room import SMALL, room_frames, room_poses

_IN_ORIGIN = FragmentPlace(np.eye(4), np.zeros(3))


def _map(capacity: int) -> KeyframeStore:
    """A map with room for `capacity` keyframes and one keyframe, at its origin."""
    first = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, capacity)
    store.append(first, np.eye(4))
    return store


def test_a_fragment_goes_on_until_the_map_has_memory_for_it():
    first = room_frames()[0]
    store = _map(4)
    store.room.allow(1)
    fragment = Fragment(SMALL, first, 0, 1, 8)
    fragment.track(first)
    joining = Joining(fragment, store, _IN_ORIGIN)
    assert [joining.step() for _ in range(4)] == [None] * 4
    assert joining.finish() is None and store.count == 1
    store.room.allow(4)
    assert joining.finish() is not None and store.count == 2


def test_a_join_is_noted_before_the_map_shows_it_and_waits_for_memory_to_note_it():
    frames, poses = room_frames(), room_poses()
    store = _map(6)
    fragment = Fragment(SMALL, frames[0], 0, 1, 8)
    for k in range(3):
        fragment.store.append(frames[k], poses[k])
    noted: list[tuple[int, JoinedFragment]] = []

    def note(joined: JoinedFragment) -> None:
        noted.append((store.count, joined))
        if len(noted) < 3:
            raise OutOfMemoryError("full")

    joining = Joining(fragment, store, _IN_ORIGIN, note)
    steps = [joining.step() for _ in range(4)]
    assert steps[:3] == [None] * 3 and steps[3] is noted[2][1]
    assert [count for count, _ in noted] == [1, 1, 1] and store.count == 4
    assert noted[2][1].keyframes.tolist() == [1, 2, 3]


def test_covariances_are_turned_into_the_axes_of_the_map():
    frames = room_frames()
    store = _map(4)
    fragment = Fragment(SMALL, frames[0], 0, 1, 8)
    unsure_along_x = np.diag([1.0, *5 * [1e-6]])
    fragment.store.append(frames[1], np.eye(4), covariance=unsure_along_x)
    quarter_turn_about_z = se3_exp(np.array([1, 2, 3, 0, 0, np.pi / 2]))
    joined = Joining(fragment, store, FragmentPlace(quarter_turn_about_z, np.zeros(3))).finish()
    assert joined is not None
    sigmas_m = np.sqrt(np.diag(store.covariance(int(joined.keyframes[0]))))[:3]
    np.testing.assert_allclose(sigmas_m, [0.02, 1.0, 0.02], atol=1e-3)


def test_keyframes_far_from_the_meeting_are_less_sure():
    """The pose of the fragment in the map has an error of rotation: 20 m away it is 20 cm."""
    frames = room_frames()
    store = _map(4)
    fragment = Fragment(SMALL, frames[0], 0, 1, 8)
    met, away = se3_exp(np.array([1, 2, 3, 0, 0, 0])), se3_exp(np.array([21, 2, 3, 0, 0, 0]))
    fragment.store.append(frames[1], met)
    fragment.store.append(frames[2], away)
    place = FragmentPlace(se3_exp(np.array([5, 0, 0, 0, 0, np.pi / 2])), met[:3, 3])
    joined = Joining(fragment, store, place).finish()
    assert joined is not None and store.count == 3
    sigmas_m = [np.sqrt(np.diag(store.covariance(k)))[:3] for k in (1, 2)]
    np.testing.assert_allclose(sigmas_m[0], 0.02)
    across = np.hypot(0.02, 20 * 0.01)
    np.testing.assert_allclose(sigmas_m[1], [across, 0.02, across], rtol=1e-6)


def test_what_odometry_alone_bridged_counts_if_its_keyframe_is_left_out():
    frames, rng = room_frames(), np.random.default_rng(0)
    store = _map(4)
    poses = np.stack([se3_exp(rng.normal(size=6)) for _ in range(5)])
    roots = 0.05 * rng.normal(size=(5, 6, 6))
    gaps = roots @ roots.swapaxes(1, 2)
    fragment = Fragment(SMALL, frames[0], 0, 1, 8)
    for k in range(5):
        fragment.store.append(frames[k], poses[k], gap_covariance=gaps[k])
    joined = Joining(
        fragment, store, FragmentPlace(se3_exp(rng.normal(size=6)), np.zeros(3))
    ).finish()
    assert joined is not None and store.count == 1 + 3
    for k, at in ((2, 2), (4, 3)):
        T_cam_next = inverse(poses[k - 1]) @ poses[k]
        J = np.stack([_moved(T_cam_next, 1e-6 * unit) / 1e-6 for unit in np.eye(6)], axis=1)
        expected = gaps[k] + J @ gaps[k - 1] @ J.T
        np.testing.assert_allclose(store.gap_covariance(at), expected, rtol=1e-4, atol=1e-7)


def test_the_newest_keyframe_is_copied_if_odometry_alone_bridged_the_way_to_it():
    frames = room_frames()
    gap = 0.01 * np.eye(6)
    for has_gap, copied in ((False, 3), (True, 4)):
        store = _map(5)
        fragment = Fragment(SMALL, frames[0], 0, 1, 8)
        for k in range(6):
            at_end = gap if has_gap and k == 5 else None
            fragment.store.append(frames[k], np.eye(4), gap_covariance=at_end)
        joined = Joining(fragment, store, _IN_ORIGIN).finish()
        assert joined is not None and store.count == 1 + copied
        assert store.gap_covariance(store.count - 1).any() == has_gap


def _moved(T_cam_next: np.ndarray, step: np.ndarray) -> np.ndarray:
    """How a camera moves, in its own axes, that is fixed to one which makes this small step in its own."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = so3_exp(step[3:]), step[:3]
    moved = inverse(T_cam_next) @ T @ T_cam_next
    return np.concatenate([moved[:3, 3], so3_log(moved[:3, :3])])


def test_a_fragment_that_is_full_retires_keyframes_and_joins_with_the_others():
    fragment = Fragment(SMALL, room_frames()[0], 0, 1, 6)
    results = [fragment.track(frame) for frame in room_frames()]
    assert results[0].status == "initial" and {r.status for r in results[1:]} == {"tracked"}
    own, kept = fragment.store, fragment.store.kept().tolist()
    assert own.count >= 8 > 6 >= len(kept) and kept[0] == 0
    store = _map(32)
    joined = Joining(fragment, store, _IN_ORIGIN).finish()
    assert joined is not None and len(joined.keyframes) == own.count
    np.testing.assert_array_equal(joined.keyframes[kept], np.arange(1, store.count))
    placed = store.poses()[joined.keyframes] @ joined.T_keyframe_own
    np.testing.assert_allclose(placed, own.poses(), atol=1e-9)


def test_a_fragment_waits_until_the_mapper_has_made_room_for_it():
    frames, poses = room_frames(), room_poses()
    store = KeyframeStore.create(
        MemoryAllocator(), frames[0].camera, frames[0].depth_units_per_m, 12
    )
    selection = KeyframeSelection(SMALL.keyframes, SMALL.mapper.max_depth_m)
    for k in range(0, 40, 4):
        store.append(frames[k], poses[k])
        selection.select(store)
    fragment = Fragment(SMALL, frames[0], 0, 1, 8)
    for k in range(6):
        fragment.store.append(frames[k], poses[k])
    joining = Joining(fragment, store, _IN_ORIGIN)
    assert joining.step() is None and joining.step() is None
    assert store.room.is_short() and store.room.free < store.room.wanted == 4
    selection.select(store)
    before = store.count
    joined = next(filter(None, (joining.step() for _ in range(4))))
    assert store.count == before + 3 and set(joined.keyframes) == set(range(before, before + 3))
    assert not store.room.wanted and store.has_room()


def test_a_fragment_that_waits_for_room_when_the_camera_ends_does_not_join_with_a_part():
    """Three keyframes are free, and it would take four: it is saved as a whole instead."""
    frames, poses = room_frames(), room_poses()
    store = KeyframeStore.create(
        MemoryAllocator(), frames[0].camera, frames[0].depth_units_per_m, 12
    )
    for k in range(9):
        store.append(frames[k], poses[k])
    fragment = Fragment(SMALL, frames[0], 0, 1, 8)
    for k in range(6):
        fragment.store.append(frames[k], poses[k])
    joining = Joining(fragment, store, _IN_ORIGIN)
    assert joining.step() is None and joining.finish() is None
    assert store.count == 9 and store.room.free == 3
    store.retire(1, 0)
    assert joining.finish() is not None


def test_a_fragment_that_does_not_come_wants_no_room():
    first = room_frames()[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 6)
    for k in range(5):
        store.append(room_frames()[k], room_poses()[k])
    fragment = Fragment(SMALL, first, 0, 1, 8)
    fragment.track(first)
    joining = Joining(fragment, store, _IN_ORIGIN)
    assert joining.step() is None and store.room.is_short()
    joining.give_up()
    assert not store.room.is_short()
    assert joining.step() is None and store.room.is_short()
    store.forget_incomplete()  # its tracker has died
    assert not store.room.is_short()
