import numpy as np
import pytest
from trimesh.grouping import group_rows

from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.meshing.extract_mesh import extract_mesh, extract_whole_mesh


@pytest.fixture(scope="module")
def mesh(scene):
    return extract_mesh(
        scene.sdf, scene.color, scene.bound, scene.camera, scene.keyframes, stride_px=2
    )


def test_two_threads_make_the_same_mesh(scene, mesh):
    other = extract_mesh(
        scene.sdf, scene.color, scene.bound, scene.camera, scene.keyframes, stride_px=2, threads=2
    )
    for name in ("vertices", "faces"):
        np.testing.assert_array_equal(getattr(other, name), getattr(mesh, name))
    np.testing.assert_array_equal(other.visual.vertex_colors, mesh.visual.vertex_colors)


def test_surface_is_the_scene(scene, mesh):
    error = np.abs(scene.distance(np.asarray(mesh.vertices)))
    assert np.percentile(error, 99) < 1e-3  # the rest are cut corners of the room
    assert error.max() < 6e-3


def test_no_hole_and_no_second_skin(mesh):
    assert len(group_rows(mesh.edges_sorted, require_count=1)) == 0
    parts = mesh.split(only_watertight=False)
    assert len(parts) == 2 and all(part.is_watertight for part in parts)
    sphere, room = 4 * np.pi * 0.5**2, 2 * (3 * 2.6 + 3 * 2 + 2.6 * 2)
    assert mesh.area == pytest.approx(sphere + room, rel=0.01)


def test_normals_point_into_free_space(scene, mesh):
    centres, normals = mesh.triangles_center, mesh.face_normals
    ahead = scene.distance(centres + 0.02 * normals)
    assert np.mean(ahead > 0) > 0.995


def test_vertices_have_the_colour_of_their_place(scene, mesh):
    rgb = np.asarray(mesh.visual.vertex_colors)[:, :3] / 255.0
    np.testing.assert_allclose(rgb, scene.color(np.asarray(mesh.vertices)), atol=0.004)


def test_only_observed_space_is_asked(scene):
    asked = []

    def query(points):
        asked.append(points)
        return scene.sdf(points)

    extract_mesh(query, scene.color, scene.bound, scene.camera, scene.keyframes[:20])
    points = np.concatenate(asked)
    assert points.dtype == np.float32
    assert np.abs(scene.distance(points)).max() < 0.11
    assert scene.bound.contains(points).all()


def test_nothing_observed_is_an_empty_mesh(scene):
    mesh = extract_mesh(scene.sdf, scene.color, scene.bound, scene.camera, [])
    assert len(mesh.vertices) == 0 and len(mesh.faces) == 0


def test_field_without_surface_is_an_empty_mesh(scene):
    mesh = extract_mesh(
        lambda p: np.ones(len(p)), scene.color, scene.bound, scene.camera, scene.keyframes[:5]
    )
    assert len(mesh.faces) == 0


def test_small_pieces_are_left_out(scene):
    def with_speck(points):
        speck = np.linalg.norm(points - [1.44, 0.0, 0.0], axis=1) - 0.025
        return np.minimum(scene.sdf(points), speck / 0.06)

    mesh = extract_mesh(with_speck, scene.color, scene.bound, scene.camera, scene.keyframes)
    assert len(mesh.split(only_watertight=False)) == 2


def test_the_whole_mesh_has_what_was_seen_and_the_skins_behind_it(scene, mesh):
    asked = []

    def query(points):
        asked.append(len(points))
        return scene.sdf(points)

    whole = extract_whole_mesh(query, scene.color, scene.bound, 0.03, threads=2)
    assert whole.area > 1.8 * mesh.area
    distance = scene.distance(np.asarray(whole.vertices))
    on_surface, on_skin = np.abs(distance) < 6e-3, np.abs(distance + 0.06) < 0.04
    assert (on_surface | on_skin).all() and on_surface.any() and on_skin.any()
    assert len(group_rows(whole.edges_sorted, require_count=1)) == 0
    assert sum(asked) > np.prod(np.floor(scene.bound.extent_m / 0.03))  # everywhere


def test_the_whole_mesh_ends_with_the_bound(scene):
    plane = extract_whole_mesh(
        lambda points: points[:, 1] - 0.01,
        scene.color,
        Bound((-0.5, -0.5, -1.3), (0.5, 0.5, 1.3)),
        0.1,
    )
    assert plane.area == pytest.approx(1.0 * 2.6, rel=1e-3)
    with pytest.raises(UserError, match=r"mesh\.voxel_m = 0"):
        extract_whole_mesh(scene.sdf, scene.color, scene.bound, 0)
