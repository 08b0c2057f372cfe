"""Distances between meshes, and what cameras saw of them."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_judge import given_views
from hsslam_node.evaluation.mesh.mesh_metrics import compare_meshes, distances, sample_surface
from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

CAMERA = Camera(64, 48, 50.0, 50.0, 31.5, 23.5)


def plane(z: float, low: float = -1.0, high: float = 1.0) -> trimesh.Trimesh:
    corners = [(low, low, z), (high, low, z), (high, high, z), (low, high, z)]
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)


def views(depth_m: float) -> Views:
    return Views(CAMERA, np.eye(4)[None], np.full((1, 48, 64), depth_m, np.float32))


POINT = st.tuples(*[st.floats(-2, 2)] * 3).map(np.array)


@given(POINT, POINT, POINT, POINT)
def test_point_to_triangle_is_never_above_a_dense_search(p, a, b, c):
    distance = distances(p[None], np.stack([a, b, c]), [(0, 1, 2)])[0]
    w = np.array([(i, j, 20 - i - j) for i in range(21) for j in range(21 - i)]) / 20
    dense = np.linalg.norm(w @ np.stack([a, b, c]) - p, axis=1).min()
    step = max(np.linalg.norm(a - b), np.linalg.norm(b - c), np.linalg.norm(c - a)) / 20
    assert dense - step - 1e-6 <= distance <= dense + 1e-6


@given(st.lists(POINT, min_size=6, max_size=60), st.integers(0, 2**31))
def test_points_on_a_surface_are_at_distance_zero(corners, seed):
    """Large triangles beside small ones, slivers, triangles through each other."""
    vertices = np.array(corners)
    faces = np.random.default_rng(seed).integers(0, len(vertices), (40, 3))
    surface = trimesh.Trimesh(vertices, faces, process=False)
    points = sample_surface(surface, 200, seed).points
    assert distances(points, vertices, faces).max(initial=0.0) < 1e-7


def test_points_exactly_on_the_true_mesh_are_scored_0_00_mm():
    """As cameras saw it, whichever triangles the samples fall on; a millimetre is a millimetre."""
    options = SourceOptions(frames=31, synth=SynthOptions(width_px=96, height_px=72))
    truth = open_ground_truth("synth:room", options)
    surface = truth.mesh() if truth else None
    assert truth is not None and surface is not None
    seen = given_views(truth, "synth:room", options)
    found = compare_meshes(surface, surface, seen, samples=30_000)
    assert f"{1000 * found.accuracy_mean_m:.2f} mm" == "0.00 mm"
    assert f"{1000 * found.completion_mean_m:.2f} mm" == "0.00 mm"
    thick = surface.copy()
    thick.vertices += 1e-3 * surface.vertex_normals
    found = compare_meshes(thick, surface, seen, samples=10_000)
    assert found.accuracy_median_m == pytest.approx(1e-3, rel=0.01)


def test_identical_meshes_are_at_distance_zero_whatever_the_sampling():
    metrics = compare_meshes(plane(0), plane(0), samples=2000)
    assert metrics.accuracy_mean_m < 1e-4
    assert metrics.completion_ratio_5cm == 1.0


def test_a_shift_is_measured_exactly():
    metrics = compare_meshes(plane(0.02), plane(0), samples=2000)
    assert metrics.accuracy_median_m == pytest.approx(0.02)
    assert metrics.completion_median_m == pytest.approx(0.02)
    assert compare_meshes(plane(0.06), plane(0), samples=2000).completion_ratio_5cm == 0.0


def test_half_a_reconstruction_is_accurate_and_incomplete():
    corners = [(0, -1, 0), (1, -1, 0), (1, 1, 0), (0, 1, 0)]
    half = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)
    metrics = compare_meshes(half, plane(0), samples=4000)
    assert metrics.accuracy_mean_m < 1e-4
    assert metrics.completion_ratio_5cm == pytest.approx(0.525, abs=0.03)


def test_sampling_is_seeded_and_uniform():
    a, b = (sample_surface(plane(0), 5000, 3).points for _ in range(2))
    np.testing.assert_array_equal(a, b)
    np.testing.assert_allclose(a.mean(axis=0), 0, atol=0.03)
    assert (a[:, 0] > 0.5).mean() == pytest.approx(0.25, abs=0.02)


def test_views_cull_what_lies_outside_or_behind():
    points = np.array([(0, 0, 2), (0, 0, 2.02), (0, 0, 2.04), (0, 0, -1), (5, 0, 2), (0, 0, 0.5)])
    np.testing.assert_array_equal(views(2.0).observed(points), [1, 1, 0, 0, 0, 1])
    assert not views(0.0).observed(points).any()  # no measurement sees nothing


def test_unobserved_surface_does_not_count():
    both = trimesh.util.concatenate([plane(2.0), plane(3.0)])
    metrics = compare_meshes(plane(2.0), both, views(2.0), samples=2000)
    assert metrics.completion_ratio_5cm == 1.0
    assert compare_meshes(plane(2.0), both, samples=2000).completion_ratio_5cm < 0.6


def test_an_empty_mesh_scores_nothing():
    metrics = compare_meshes(trimesh.Trimesh(), plane(0), samples=100)
    assert (metrics.completion_ratio_5cm, metrics.samples) == (0.0, 0)
    assert np.isnan(metrics.accuracy_mean_m)


class _Half:
    """Sees a random half of what it is asked for."""

    def observed(self, points: np.ndarray) -> np.ndarray:
        return np.random.default_rng(0).random(len(points)) < 0.5


def test_samples_lie_on_all_faces_alike_in_the_order_of_the_faces():
    """Also if the last of several draws is cut short."""
    strips = [plane(z) for z in range(5)]
    surface = trimesh.util.concatenate(strips)  # ten faces of one area
    samples = sample_surface(surface, 20_000, 0, _Half())
    assert (np.diff(samples.faces) >= 0).all()
    np.testing.assert_allclose(np.bincount(samples.faces, minlength=10), 2000, atol=200)
    np.testing.assert_allclose(samples.points[:, 2], samples.faces // 2, atol=1e-12)
    again = sample_surface(surface, 20_000, 0, _Half())
    np.testing.assert_array_equal(samples.points, again.points)
