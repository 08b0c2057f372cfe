"""The literature's mesh scores: what each mesh hides of itself, and what points say of surfaces."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from hsslam_node.evaluation.mesh.mesh_metrics import MeshMetrics, compare_meshes
from hsslam_node.evaluation.mesh.published_protocol import (
    CullingCameras,
    OwnDepth,
    compare_as_published,
)
from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import se3_exp

_CAMERA = Camera(64, 48, 50.0, 50.0, 31.5, 23.5)
_AHEAD = np.eye(4)[None]
_NONE = np.empty((0, 4, 4))
_SAMPLES = 20_000


def _wall(z_m: float, half_m: float = 4.0) -> trimesh.Trimesh:
    wall = trimesh.creation.box((2 * half_m, 2 * half_m, 1e-3))
    wall.apply_translation([0, 0, z_m])
    return wall


def _step() -> trimesh.Trimesh:
    """A wall, and a box before it: no motion maps it onto itself."""
    box = trimesh.creation.box((0.5, 0.4, 0.3))
    box.apply_translation([0.1, 0.05, 1.5])
    return trimesh.util.concatenate([_wall(2.0), box])


def _published(
    mesh: trimesh.Trimesh, truth: trimesh.Trimesh, virtual: np.ndarray = _NONE, seed: int = 0
) -> MeshMetrics:
    cameras = CullingCameras(_CAMERA, _AHEAD, virtual)
    return compare_as_published(mesh, truth, cameras, _SAMPLES, seed)


def test_points_never_meet_points_where_the_exact_protocol_finds_the_surface():
    depth_m = np.full((1, 48, 64), 2.0, np.float32)
    exact = compare_meshes(_wall(2.0), _wall(2.0), Views(_CAMERA, _AHEAD, depth_m), _SAMPLES)
    assert exact.accuracy_mean_m < 1e-9
    published = _published(_wall(2.0), _wall(2.0))
    seen_m2 = 2 * (2.0 * 64 / 50) * (2.0 * 48 / 50)  # both sides of the wall
    between_m = 0.5 * np.sqrt(seen_m2 / _SAMPLES)  # to the nearest of randomly placed points
    assert published.accuracy_mean_m == pytest.approx(between_m, rel=0.3)


def test_a_mesh_is_culled_by_itself_and_not_by_the_truth():
    """A wall 30 cm behind the true one: hidden from the exact protocol, which the literature's is not."""
    depth_m = np.full((1, 48, 64), 2.0, np.float32)
    exact = compare_meshes(_wall(2.3), _wall(2.0), Views(_CAMERA, _AHEAD, depth_m), _SAMPLES)
    assert exact.samples == 0
    published = _published(_wall(2.3), _wall(2.0))
    assert published.accuracy_mean_m == pytest.approx(0.3, abs=0.02)
    assert published.completion_ratio_5cm == 0.0


def test_what_lies_behind_the_mesh_itself_does_not_count():
    both = trimesh.util.concatenate([_wall(2.0), _wall(3.0, 1.0)])
    assert _published(both, _wall(2.0)).accuracy_mean_m < 0.03


def test_virtual_cameras_show_what_hides_within_the_given_frustums_alone():
    mesh = _step()
    hidden, beside = np.array([[0.1, 0.05, 2.0]]), np.array([[3.5, 0.0, 2.0]])
    aside = se3_exp(np.array([1.6, 0, 0.4, 0, -0.8, 0]))[None]
    alone = OwnDepth(mesh, CullingCameras(_CAMERA, _AHEAD, _NONE))
    assert not alone.observed(hidden).any()
    helped = OwnDepth(mesh, CullingCameras(_CAMERA, _AHEAD, aside))
    assert helped.observed(hidden).all()
    towards = se3_exp(np.array([3.5, 0, 0, 0, 0, 0]))[None]
    assert not OwnDepth(mesh, CullingCameras(_CAMERA, _AHEAD, towards)).observed(beside).any()


def test_icp_takes_off_a_shift_that_the_exact_protocol_reports():
    moved = _step()
    moved.apply_translation([0.01, -0.01, 0.02])
    depth_m = np.full((1, 48, 64), 2.1, np.float32)
    exact = compare_meshes(moved, _step(), Views(_CAMERA, _AHEAD, depth_m), _SAMPLES)
    assert exact.accuracy_mean_m > 0.01
    still = _published(_step(), _step()).accuracy_mean_m
    assert _published(moved, _step()).accuracy_mean_m == pytest.approx(still, rel=0.1)


def test_scores_are_those_of_trees_of_points_that_trimesh_draws():
    truth = trimesh.creation.icosphere(4, 0.5)
    mesh = trimesh.creation.icosphere(2, 0.49)
    around = [se3_exp(np.array([0, 0, 0, 0, k * np.pi / 3, 0])) for k in range(6)]
    back = np.eye(4)
    back[2, 3] = -2.0
    poses = [T @ back for T in around]
    poses += [se3_exp(np.array([0, 0, 0, s * np.pi / 2, 0, 0])) @ back for s in (1, -1)]
    found = compare_as_published(
        mesh, truth, CullingCameras(_CAMERA, np.array(poses), _NONE), _SAMPLES
    )
    ours = KDTree(trimesh.sample.sample_surface(mesh, _SAMPLES, seed=3)[0])
    theirs = KDTree(trimesh.sample.sample_surface(truth, _SAMPLES, seed=4)[0])
    assert found.samples == _SAMPLES
    assert found.accuracy_mean_m == pytest.approx(theirs.query(ours.data)[0].mean(), rel=0.02)
    assert found.completion_mean_m == pytest.approx(ours.query(theirs.data)[0].mean(), rel=0.02)
    assert found == compare_as_published(
        mesh, truth, CullingCameras(_CAMERA, np.array(poses), _NONE), _SAMPLES
    )


def test_a_mesh_that_no_camera_sees_scores_nothing():
    metrics = _published(_wall(-2.0), _wall(2.0))
    assert (metrics.completion_ratio_5cm, metrics.samples) == (0.0, 0)
    assert np.isnan(metrics.accuracy_mean_m)
