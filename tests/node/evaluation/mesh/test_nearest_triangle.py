"""The nearest point on a mesh is the same in parts as over all triangles at once."""

import numpy as np
import trimesh

from hsslam_node.evaluation.mesh.nearest_triangle import nearest_points


def test_parts_find_what_all_triangles_at_once_do():
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    far = trimesh.creation.icosphere(subdivisions=3, radius=0.3).apply_translation([5.0, 0.0, 0.0])
    mesh = trimesh.util.concatenate([far, sphere])
    points = np.random.default_rng(0).uniform(-2.0, 6.0, (2000, 3))
    distance_m, feet = nearest_points(points, mesh.vertices, mesh.faces)
    for at_once in (100, 1280, 5000):
        found_m, places = nearest_points(points, mesh.vertices, mesh.faces, at_once)
        np.testing.assert_allclose(found_m, distance_m, rtol=0, atol=1e-12)
        np.testing.assert_allclose(places, feet, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(points - feet, axis=1), distance_m, atol=1e-9)


def test_a_mesh_without_triangles_is_infinitely_far():
    distance_m, _ = nearest_points(np.zeros((2, 3)), np.zeros((3, 3)), np.zeros((0, 3), np.int64))
    assert np.isinf(distance_m).all()
