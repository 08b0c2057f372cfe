"""A chair that is carried off while the camera looks elsewhere, at true poses, ten small frames a second."""

import numpy as np
import pytest

from hsslam_bench.free_space.former_place import FormerPlace
from hsslam_bench.free_space.moved import freed, place_and_thing, true_poses
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

_OPTIONS = SourceOptions(synth=SynthOptions(width_px=160, height_px=120), stride=3)


@pytest.fixture(scope="module")
def place() -> FormerPlace:
    return place_and_thing(_OPTIONS)[0]


def test_its_place_is_free_within_a_second_of_being_seen_through():
    found = freed(_OPTIONS, true_poses())
    assert found.was_occupied
    assert found.grid_s is not None and found.grid_s <= 1.0
    assert found.distances_s is not None and found.distances_s <= 1.0


def test_vertices_in_its_box_are_counted_and_those_of_the_floor_are_not(place):
    T = np.linalg.inv(place.T_room_world)
    room = np.array([[2.25, 2.45, 0.45], [2.25, 2.45, 0.012], [2.25, 2.45, 1.2], [0.0, 0, 0.45]])
    assert place.count_inside(room @ T[:3, :3].T + T[:3, 3]) == 1
