"""Mapping refines the poses of its windows where a preset says so."""

from dataclasses import replace

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.slam import Slam
from tests.small_room import SMALL, MappedRoom, displaced, mapped_room, pose_error, room_frames


def _config(**mapper) -> SlamConfig:
    return replace(SMALL, mapper=replace(SMALL.mapper, **{"pose_rate": 1e-3, **mapper}))


def _errors(room: MappedRoom) -> np.ndarray:
    """Distance, m, and angle, degrees, of each keyframe from its true pose, [10, 2]."""
    truth = mapped_room().store.poses()
    return np.array(
        [pose_error(T, true) for T, true in zip(room.store.poses(), truth, strict=True)]
    )


def _refine(room: MappedRoom, keyframes: int, iterations: int = 15) -> None:
    """As after this many keyframes."""
    mapper = Mapper(room.config, room.parameters, 0)
    for _ in range(keyframes):
        for _ in range(iterations):
            mapper.iterate(room.store)
        refined = mapper.take_poses(room.store)
        assert refined is not None
        room.store.correct_poses(*refined)


def test_a_displaced_keyframe_is_pulled_back_and_the_others_stay():
    room = mapped_room(_config())
    room.store.correct_poses(np.array([6]), displaced(room.store.pose(6), 0.02, 1.0)[None])
    _refine(room, 10)
    errors = _errors(room)
    assert errors[6, 0] < 0.008 and errors[6, 1] < 0.4
    assert np.delete(errors, 6, axis=0).max(axis=0)[0] < 0.008
    assert not errors[0].any()  # the oldest of all


def test_the_oldest_keyframe_of_a_window_stays():
    room = mapped_room(_config(window_keyframes=3))
    mapper = Mapper(room.config, room.parameters, 0)
    mapper.iterate(room.store)
    refined = mapper.take_poses(room.store)
    assert refined is not None and refined.keyframes.tolist() == [8, 9] and refined.known == 10
    np.testing.assert_array_less(
        1e-6, np.abs(refined.T_world_cam - room.store.poses()[8:]).max(axis=(1, 2))
    )
    assert mapper.take_poses(room.store) is None


def test_an_iteration_goes_on_from_the_poses_of_the_one_before():
    room = mapped_room(_config(window_keyframes=2))
    mapper = Mapper(room.config, room.parameters, 0)
    seen = []
    step = mapper._optimiser.step

    def noted(store, keyframes, counts, poses, generator, **how):
        seen.append(poses().copy())
        return step(store, keyframes, counts, seen[-1], generator, **how)

    mapper._optimiser.step = noted
    for _ in range(3):
        mapper.iterate(room.store)
    np.testing.assert_array_equal(seen[0], room.store.poses()[[9, 8]])
    assert (seen[1][0] != seen[0][0]).any() and (seen[2][0] != seen[1][0]).any()
    np.testing.assert_array_equal(seen[2][1], seen[0][1])


def test_poses_stay_before_the_fifth_keyframe_and_without_a_rate():
    for rate, count in ((1e-3, 4), (0.0, 10)):
        room = mapped_room(_config(pose_rate=rate))
        room.store._header[0] = count  # as it was when there were so many
        mapper = Mapper(room.config, room.parameters, 0)
        mapper.iterate(room.store)
        assert mapper.take_poses(room.store) is None


def test_slam_writes_the_refined_poses():
    config = replace(
        _config(first_iterations=100), ba=replace(SMALL.ba, enabled=False),
        keyframes=replace(SMALL.keyframes, every_frames=2),
    )  # fmt: skip
    slam = Slam(config)
    results = list(slam.run(room_frames()[:20]))
    assert slam.store is not None and slam.store.count >= 6
    assert slam.store.pose_version == slam.store.count - 4
    assert all(r.status == "tracked" for r in results[1:])
