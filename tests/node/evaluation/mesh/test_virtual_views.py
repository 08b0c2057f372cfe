"""Views from where no camera was, and the depth error in them."""

import numpy as np
import pytest
import trimesh

from hsslam_node.evaluation.mesh.depth_l1 import depth_l1
from hsslam_node.evaluation.mesh.virtual_views import MOVED_M, TURNED_RAD, virtual_views
from hsslam_node.evaluation.mesh.visibility import Views
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import inverse, se3_exp, so3_log
from hsslam_node.rendering.chunked_mesh import chunked_mesh
from hsslam_node.rendering.depth_render import render_depth

CAMERA = Camera(48, 36, 40.0, 40.0, 23.5, 17.5)


def _room() -> trimesh.Trimesh:
    """A closed room of 4 x 4 x 3 m about the origin with a second one beyond its wall."""
    rooms = [trimesh.creation.box((4, 4, 3)), trimesh.creation.box((4, 4, 3))]
    rooms[1].apply_translation([4.2, 0, 0])
    return trimesh.util.concatenate(rooms)


@pytest.fixture(scope="module")
def seen() -> Views:
    """Cameras in the middle of the first room that look all around, level, up and down."""
    room = _room()
    turns = [se3_exp(np.array([0, 0, 0, 0, k * np.pi / 4, 0.0])) for k in range(8)]
    pitches = [se3_exp(np.array([0, 0, 0, k * np.pi / 4, 0.0, 0.0])) for k in (0, 1, -1, 2, -2)]
    poses = [turn @ pitch for pitch in pitches for turn in turns]
    surface = chunked_mesh(room.vertices, room.faces)
    depths = [render_depth(surface, CAMERA, T)[0] for T in poses]
    return Views(CAMERA, np.array(poses), np.array(depths))


def test_views_are_near_a_camera_and_show_what_it_saw(seen):
    views = list(virtual_views(_room(), seen, CAMERA, 12))
    assert len(views) == 12
    for T, depth in views:
        apart = [inverse(given) @ T for given in seen.T_world_cam]
        assert any(
            np.linalg.norm(M[:3, 3]) <= MOVED_M and np.linalg.norm(so3_log(M)) <= TURNED_RAD
            for M in apart
        )
        assert np.abs(world_points(depth, CAMERA, T)).max() < 2.01  # never the second room
        assert seen.observed(world_points(depth, CAMERA, T)).mean() > 0.9


def test_one_seed_gives_the_same_views(seen):
    first, again, other = (
        np.array([T for T, _ in virtual_views(_room(), seen, CAMERA, 4, seed)])
        for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_camera_before_a_wall_does_not_step_through_it():
    """30 cm before a wall: the views stay on its side."""
    wall = trimesh.creation.box((0.1, 20, 20))
    wall.apply_translation([-0.35, 0, 0])
    back = trimesh.creation.box((0.1, 40, 40))
    back.apply_translation([4, 0, 0])
    both = trimesh.util.concatenate([wall, back])
    T = np.eye(4)
    T[:3, :3] = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # looks along +x
    depth = render_depth(chunked_mesh(both.vertices, both.faces), CAMERA, T)[0]
    given = Views(CAMERA, np.stack([T]), depth[None])
    for pose, _ in virtual_views(both, given, CAMERA, 6):
        assert pose[0, 3] > -0.30


def test_depth_error_of_the_truth_is_none_and_of_nothing_is_the_depth(seen):
    room, views = _room(), list(virtual_views(_room(), seen, CAMERA, 5))
    assert depth_l1(room, views, CAMERA, seen).mean_m < 1e-6
    nothing = depth_l1(trimesh.Trimesh(), views, CAMERA, seen)
    counted = [d[d > 0][seen.observed(world_points(d, CAMERA, T))] for T, d in views]
    assert nothing.mean_m == pytest.approx(np.concatenate(counted).mean(), rel=1e-5)
    assert nothing.hole_ratio == 1.0


def test_depth_error_is_the_shift_that_was_put_in(seen):
    """One pose that looks straight at a wall, which is 5 cm too far."""
    views = [(seen.T_world_cam[0], seen.depths_m[0])]
    wall = trimesh.creation.box((30, 30, 0.1))
    wall.apply_translation([0, 0, 1.5 + 0.05 + 0.05])
    found = depth_l1(wall, views, CAMERA, seen)
    assert (found.mean_m, found.views) == (pytest.approx(0.05, abs=1e-5), 1)
