"""The corridor: bare, and still not without hold."""

import numpy as np
import pytest

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.synth.scenes.corridor import build_corridor, corridor_poses
from tests.node.synth.back_projection import back_projected
from tests.node.synth.true_surface import clearance_m, depth_errors_m

_OPTIONS = SourceOptions(synth=SynthOptions(width_px=160, height_px=120), stride=60)


@pytest.fixture(scope="module")
def frames():
    return list(open_source("synth:corridor", _OPTIONS).frames())


@pytest.fixture(scope="module")
def truth():
    return open_ground_truth("synth:corridor", _OPTIONS)


@pytest.fixture(scope="module")
def mesh(truth):
    return truth.mesh()


def test_the_way_leads_through_the_corridor_and_keeps_clear(mesh):
    positions = corridor_poses(None, 0)[:, :3, 3]
    assert positions[0, 0] < 3 and positions[-1, 0] > 19
    assert clearance_m(positions[::3], mesh).min() > 0.3


def test_depth_lies_on_the_true_mesh(frames, truth, mesh):
    error_m = depth_errors_m(frames[5], truth.T_world_cam[5], mesh)
    assert np.quantile(error_m, 0.9) < 0.0003  # steps of the depth image: 0.2 mm
    assert np.quantile(error_m, 0.99) < 0.02


def test_along_its_axis_the_geometry_gives_little_hold(frames, truth):
    """In the corridor few surfaces within the sensor's reach face along it, but some do."""
    shares = []
    for frame, T in zip(frames, truth.T_world_cam, strict=True):
        if not 6 < T[0, 3] < 14:
            continue
        points = back_projected(frame).reshape(*frame.depth_raw.shape, 3) @ T[:3, :3].T
        across, down = points[:-1, 1:] - points[:-1, :-1], points[1:, :-1] - points[:-1, :-1]
        normal = np.cross(across, down)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True) + 1e-12
        near = frame.depth_m()[:-1, :-1] < 6
        shares.append((np.abs(normal[near][:, 0]) > 0.7).mean())
    assert len(shares) >= 3
    assert max(shares) < 0.12
    assert min(shares) < 0.03


def test_walls_are_faint_and_not_blank(frames):
    """A patch of bare wall has less contrast than a wallpaper, and more than none."""
    contrast = [float(f.color.mean(axis=2)[70:90, 20:40].std()) for f in frames]
    assert 0.5 < np.median(contrast) < 12


def test_the_same_seed_gives_the_same_bytes(frames):
    again = next(open_source("synth:corridor", _OPTIONS).frames())
    np.testing.assert_array_equal(again.color, frames[0].color)
    np.testing.assert_array_equal(again.depth_raw, frames[0].depth_raw)
    parts = build_corridor(0).still_parts
    assert [p.materials for p in parts] == [p.materials for p in build_corridor(0).still_parts]
