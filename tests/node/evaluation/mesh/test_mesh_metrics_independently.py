"""Mesh metrics within 1 % of those of dense samples; distances against those of Open3D."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from hsslam_node.evaluation.mesh.mesh_metrics import compare_meshes, distances

_DENSE = 1_000_000
_SAMPLES = 50_000


@pytest.fixture(scope="module")
def meshes() -> tuple[trimesh.Trimesh, trimesh.Trimesh]:
    """A truth of large and of small triangles; a bumpy reconstruction of it with a hole and a blob."""
    table, ball = trimesh.creation.box((0.8, 0.6, 0.3)), trimesh.creation.icosphere(3, 0.2)
    ball.apply_translation([0.1, 0, 0.4])
    truth = trimesh.util.concatenate([table, ball])
    fine = truth.subdivide_to_size(0.04)
    rng = np.random.default_rng(0)
    bumps = rng.normal(0, 0.008, (len(fine.vertices), 1)) + 0.01
    bumpy = trimesh.Trimesh(fine.vertices + bumps * fine.vertex_normals, fine.faces, process=False)
    bumpy.update_faces(bumpy.triangles_center[:, 0] < 0.25)
    blob = trimesh.creation.icosphere(2, 0.08)
    blob.apply_translation([-0.6, 0, 0])
    return trimesh.util.concatenate([bumpy, blob]), truth


def test_against_a_kd_tree_of_dense_samples(meshes):
    ours, truth = meshes
    found = compare_meshes(ours, truth, samples=_SAMPLES)
    for a, b, mean_m, median_m, ratio in (
        (
            *(ours, truth, found.accuracy_mean_m),
            *(found.accuracy_median_m, found.accuracy_ratio_5cm),
        ),
        (
            *(truth, ours, found.completion_mean_m),
            *(found.completion_median_m, found.completion_ratio_5cm),
        ),
    ):
        points = trimesh.sample.sample_surface(a, _SAMPLES, seed=7)[0]
        tree = KDTree(trimesh.sample.sample_surface(b, _DENSE, seed=8)[0])
        expected, _ = tree.query(points)
        assert mean_m == pytest.approx(expected.mean(), rel=0.01)
        assert median_m == pytest.approx(np.median(expected), rel=0.01)
        assert ratio == pytest.approx((expected < 0.05).mean(), rel=0.01)


def test_against_exact_distances_of_open3d(meshes):
    o3d = pytest.importorskip("open3d", exc_type=ImportError)
    ours, truth = meshes
    for a, b in ((ours, truth), (truth, ours)):
        points = trimesh.sample.sample_surface(a, _SAMPLES, seed=7)[0]
        scene = o3d.t.geometry.RaycastingScene()
        corners = o3d.core.Tensor(np.asarray(b.vertices, np.float32))
        scene.add_triangles(corners, o3d.core.Tensor(np.asarray(b.faces, np.uint32)))
        expected = scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()
        np.testing.assert_allclose(distances(points, b.vertices, b.faces), expected, atol=1e-5)
