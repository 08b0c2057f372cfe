"""The built-in room as a source: exact, seeded, furnished."""

import numpy as np
import pytest

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_metrics import distances
from hsslam_node.geometry.se3 import inverse
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from tests.node.synth.back_projection import back_projected

SYNTH = SynthOptions(width_px=160, height_px=120)
OPTIONS = SourceOptions(synth=SYNTH, stride=60)


@pytest.fixture(scope="module")
def frames():
    return list(open_source("synth:room", OPTIONS).frames())


@pytest.fixture(scope="module")
def truth():
    return open_ground_truth("synth:room", OPTIONS)


def test_frames_and_truth_agree_in_number_and_stamps(frames, truth):
    assert len(frames) == 10
    assert [f.stamp_ns for f in frames] == list(truth.stamps_ns)
    assert all(f.depth_raw.min() > 0 for f in frames)


def test_depth_lies_on_the_mesh_of_the_scene(frames, truth):
    surface = truth.mesh()
    frame, T = frames[3], truth.T_world_cam[3]
    error_m = distances(
        (back_projected(frame) @ T[:3, :3].T + T[:3, 3])[::7], surface.vertices, surface.faces
    )
    assert np.quantile(error_m, 0.9) < 0.0003  # steps of the depth image: 0.2 mm
    assert np.quantile(error_m, 0.995) < 0.02


def test_two_views_of_a_point_have_the_same_color(truth):
    near = SourceOptions(synth=SYNTH, frames=6)
    first, *_, last = list(open_source("synth:room", near).frames())
    poses = open_ground_truth("synth:room", near).T_world_cam
    T = inverse(poses[-1]) @ poses[0]
    points = back_projected(first) @ T[:3, :3].T + T[:3, 3]
    c = first.camera
    u = np.rint(points[:, 0] / points[:, 2] * c.fx + c.cx).astype(int)
    v = np.rint(points[:, 1] / points[:, 2] * c.fy + c.cy).astype(int)
    inside = (u >= 0) & (u < c.width_px) & (v >= 0) & (v < c.height_px)
    u, v, z = u[inside], v[inside], points[inside, 2]
    visible = np.abs(last.depth_m()[v, u] - z) < 0.02
    assert visible.mean() > 0.9
    ours = first.color.reshape(-1, 3)[inside][visible].astype(float)
    theirs = last.color[v[visible], u[visible]].astype(float)
    assert np.median(np.abs(ours - theirs)) < 6
    assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] > 0.9


def test_every_view_is_textured_and_furnished(frames):
    for frame in frames:
        gray = frame.color.mean(axis=2)
        assert gray.std() > 15
        assert np.abs(np.diff(gray, axis=1)).mean() > 2
        assert np.ptp(np.quantile(frame.depth_m(), [0.05, 0.95])) > 0.3


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_room(frames):
    once = next(open_source("synth:room", OPTIONS).frames())
    np.testing.assert_array_equal(once.color, frames[0].color)
    np.testing.assert_array_equal(once.depth_raw, frames[0].depth_raw)
    synth = SynthOptions(width_px=160, height_px=120, seed=1)
    other = next(open_source("synth:room", SourceOptions(synth=synth)).frames())
    assert (other.color != once.color).mean() > 0.3
    assert other.depth_raw.shape == once.depth_raw.shape


@pytest.mark.parametrize(("size_m", "seed"), [((4.0, 4.0, 2.4), 0), ((9.0, 8.0, 3.0), 7)])
def test_other_sizes_render_without_holes(size_m, seed):
    synth = SynthOptions(size_m=size_m, width_px=96, height_px=72, seed=seed)
    frames = list(open_source("synth:room", SourceOptions(synth=synth, stride=75)).frames())
    diagonal = float(np.linalg.norm(size_m))
    for frame in frames:
        assert frame.depth_m().min() > 0.15
        assert frame.depth_m().max() < diagonal
