"""A saved map that a camera localises in, or goes on with."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.errors import UserError
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_node.slam import Slam
from tests.small_room import (
    SMALL,
    mapped_room,
    pose_error,
    room_frames,
    room_poses,
    with_black,
)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    room = mapped_room()
    path = tmp_path_factory.mktemp("map") / "room.safetensors"
    save_checkpoint(path, map_snapshot(room.store, room.parameters, SMALL))
    return path


def test_localising_finds_the_place_and_changes_nothing(path):
    before = path.read_bytes()
    slam = Slam(SMALL, saved_map=path, localise_only=True)
    assert slam.parameters and slam.store
    params, keyframes = slam.parameters.params.copy(), slam.store.count
    for k in (2, 3, 5, 6, 7):  # the newest keyframe is 36
        result = slam.process(room_frames()[k])
        assert result.status == "tracked"
        distance_m, angle_deg = pose_error(result.T_world_cam, room_poses()[k])
        assert distance_m < 0.02 and angle_deg < 1.0
        assert not result.is_keyframe and 0 <= result.keyframe < keyframes
    for k in (37, 38):  # carried on
        result = slam.process(room_frames()[k])
        assert result.status == "tracked"
        assert pose_error(result.T_world_cam, room_poses()[k])[0] < 0.02
    slam.finish()
    assert slam.store.count == keyframes and slam.parameters.version == 1
    np.testing.assert_array_equal(slam.parameters.params, params)
    assert path.read_bytes() == before


def test_mapping_goes_on_in_it(path):
    slam = Slam(SMALL, saved_map=str(path))
    assert slam.parameters and slam.store
    inherited, steps = slam.store.count, slam.parameters.step
    for k in range(1, 11):
        result = slam.process(room_frames()[k])
        assert result.status == "tracked"
        assert pose_error(result.T_world_cam, room_poses()[k])[0] < 0.02
    assert slam.store.count > inherited == slam.store.inherited
    assert slam.parameters.version > 1 and slam.parameters.step > steps
    slam.finish()
    assert len(slam.store.kept()) <= inherited + 1  # the map shows all of this


def test_without_a_map_there_is_nothing_to_localise_in():
    with pytest.raises(UserError, match="expected a saved map"):
        Slam(SMALL, localise_only=True)


def test_tracking_by_rendering_cannot_find_its_place(path):
    config = replace(SMALL, tracker=replace(SMALL.tracker, method="rendering"))
    with pytest.raises(UserError, match=r"tracker.method = rendering: .*expected alignment"):
        Slam(config, saved_map=path)


def test_a_camera_that_is_lost_when_mapping_goes_on_is_found_as_when_localising(path):
    found = {}
    for localise_only in (True, False):
        slam = Slam(SMALL, saved_map=path, localise_only=True)
        assert slam.store
        keyframes = slam.store.count
        for k in (2, 3, 5):
            assert slam.process(room_frames()[k]).status == "tracked"
        assert [slam.process(with_black(room_frames()[k])).status for k in (6, 7, 8)] == [
            "lost"
        ] * 3
        slam.localise_only = localise_only
        results = [slam.process(room_frames()[k]) for k in range(30, 40)]
        found[localise_only] = [r.status for r in results]
        first = next(k for k, r in enumerate(results) if r.status == "tracked")
        assert pose_error(results[first].T_world_cam, room_poses()[30 + first])[0] < 0.02
        assert (slam.store.count > keyframes) != localise_only
    assert found[True] == found[False] and found[False][-1] == "tracked"
