"""The apartment: a long loop through free space, exact."""

from itertools import pairwise

import numpy as np
import pytest

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.synth.scenes.apartment import DOORS_M, apartment_poses, build_apartment
from tests.node.synth.true_surface import clearance_m, depth_errors_m

_SYNTH = SynthOptions(width_px=160, height_px=120)
_OPTIONS = SourceOptions(synth=_SYNTH, stride=180)


@pytest.fixture(scope="module")
def frames():
    return list(open_source("synth:apartment", _OPTIONS).frames())


@pytest.fixture(scope="module")
def mesh():
    return open_ground_truth("synth:apartment", _OPTIONS).mesh()


def test_the_loop_is_long_and_closes():
    positions = apartment_poses(None, 0)[:, :3, 3]
    ring = np.concatenate([positions, positions[:1]])
    steps_m = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    assert steps_m.sum() > 60
    assert steps_m.max() < 0.035
    assert 1800 <= len(positions) <= 2400


def test_no_room_is_visited_twice():
    """Before the end, no place is passed again: drift has no help on the way."""
    positions = apartment_poses(None, 0)[:, :2, 3]
    for door in DOORS_M:
        near = np.flatnonzero(np.linalg.norm(positions - door, axis=1) < 0.6)
        assert len(near) > 20
        assert np.ptp(near) == len(near) - 1


def test_the_way_keeps_clear_of_walls_and_furniture(mesh):
    positions = apartment_poses(None, 0)[:, :3, 3]
    assert clearance_m(positions[::3], mesh).min() > 0.3  # no wall between frames 3 cm apart either


def test_depth_lies_on_the_true_mesh(frames, mesh):
    truth = open_ground_truth("synth:apartment", _OPTIONS)
    assert [f.stamp_ns for f in frames] == list(truth.stamps_ns)
    for k in (2, 7):
        error_m = depth_errors_m(frames[k], truth.T_world_cam[k], mesh)
        assert np.quantile(error_m, 0.9) < 0.0003  # steps of the depth image: 0.2 mm
        assert np.quantile(error_m, 0.99) < 0.02


def test_every_view_is_textured_and_closed(frames):
    for frame in frames:
        measured = frame.depth_raw[frame.depth_raw > 0]
        assert measured.min() > 0.25 * frame.depth_units_per_m
        assert measured.size > 0.95 * frame.depth_raw.size  # depth beyond 13.1 m does not fit
        assert frame.color.mean(axis=2).std() > 12


def test_the_last_view_is_the_first_one_again():
    ends = SynthOptions(width_px=160, height_px=120, length=len(apartment_poses(None, 0)))
    options = SourceOptions(synth=ends, stride=ends.length - 1)
    first, last = list(open_source("synth:apartment", options).frames())
    seen_alike = np.abs(first.depth_m() - last.depth_m()) < 0.05
    assert seen_alike.mean() > 0.85


def test_rooms_differ(frames):
    """Places are told apart by what they look like."""
    small = [f.color[::8, ::8].reshape(-1).astype(float) for f in frames]
    for one, other in pairwise(small):
        assert np.corrcoef(one, other)[0, 1] < 0.8


def test_the_same_seed_gives_the_same_scene_and_another_seed_another():
    one, again, other = (
        build_apartment(0).still_parts,
        build_apartment(0).still_parts,
        build_apartment(1).still_parts,
    )
    assert [p.materials for p in one] == [p.materials for p in again]
    assert np.array_equal([p.center_m for p in one], [p.center_m for p in again])
    assert [p.materials for p in one] != [p.materials for p in other]
