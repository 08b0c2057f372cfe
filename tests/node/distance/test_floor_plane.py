import numpy as np
import pytest

from hsslam_node.distance.floor_plane import FloorPlane, find_floor
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.se3 import se3_exp
from tests.node.distance.conftest import wall
from tests.small_room import OPTIONS, room_frames, room_poses


@pytest.fixture(scope="module")
def views():
    return [(f.depth_m(), T) for f, T in zip(room_frames(), room_poses(), strict=True)][::4]


@pytest.fixture(scope="module")
def true_up():
    """In the world of the first camera, and the height of the floor along it."""
    truth = open_ground_truth("synth:room", OPTIONS)
    T_room_first = truth.T_world_cam[0]
    return T_room_first[2, :3], -T_room_first[2, 3]


def _angle_deg(a, b):
    return np.rad2deg(np.arccos(np.clip(np.dot(a, b), -1, 1)))


def test_the_floor_of_the_room_is_found(views, true_up):
    floor = find_floor(views, room_frames()[0].camera)
    up, height_m = true_up
    assert floor.source == "floor plane" and floor.is_seen
    assert _angle_deg(floor.up, up) < 0.5
    assert abs(floor.height_m - height_m) < 0.02


def test_a_known_direction_is_kept_and_the_height_found(views, true_up):
    up, height_m = true_up
    floor = find_floor(views, room_frames()[0].camera, 3 * up, "gravity")
    assert floor.source == "gravity" and np.allclose(floor.up, up)
    assert abs(floor.height_m - height_m) < 0.02


def test_without_a_floor_up_is_as_the_cameras_are_held(camera):
    floor = find_floor([(wall(2.0), np.eye(4))] * 3, camera)
    assert floor.source == "camera poses"
    assert np.allclose(floor.up, [0, -1, 0])
    assert floor.height_m == pytest.approx(-0.73, abs=0.02)  # the lowest that was seen
    assert not floor.is_seen and floor.text.endswith(
        "no floor seen whose normal is within 40 degrees of it: the lowest measured points, "
        f"at {floor.height_m:.2f} m along it, stand for it"
    )


def test_the_floor_under_a_camera_that_looks_straight_down_and_turns_is_found(camera):
    turned = [se3_exp(np.array([0, 0, 0, 0, 0, angle])) for angle in np.linspace(0, 2 * np.pi, 9)]
    floor = find_floor([(wall(2.0), T) for T in turned[:-1]], camera)
    assert floor.source == "floor plane" and floor.is_seen
    assert np.allclose(floor.up, [0, 0, -1], atol=1e-6)
    assert floor.height_m == pytest.approx(-2.0, abs=1e-3)


def test_depth_too_far_for_a_floor_is_passed_over(camera):
    depth = wall(2.0)
    depth[80:] = 65.535
    assert find_floor([(depth, np.eye(4))], camera).height_m == pytest.approx(-0.25, abs=0.02)


@pytest.mark.parametrize("every", [(8, 1), (4, 4), (1, 20)], ids=["rows", "grid", "columns"])
def test_depth_too_sparse_for_normals_still_has_a_lowest_point(camera, every):
    depth = np.zeros_like(wall(2.0))
    depth[:: every[0], :: every[1]] = 2.0
    floor = find_floor([(depth, np.eye(4))] * 3, camera)
    assert floor.source == "camera poses"
    assert floor.height_m == pytest.approx(-0.73, abs=0.1)
    known = find_floor([(depth, np.eye(4))], camera, np.array([0.0, -1.0, 0.0]), "gravity")
    assert known.source == "gravity" and known.height_m == pytest.approx(-0.73, abs=0.1)


def test_depth_counts_as_far_as_the_map_uses_it(camera):
    views = [(wall(20.0), np.eye(4))]
    with pytest.raises(UserError, match="no view has depth below 12 m"):
        find_floor(views, camera)
    assert find_floor(views, camera, max_depth_m=30.0).height_m < -5.0


def test_the_frame_of_the_floor_has_z_up_and_the_floor_at_zero():
    up = np.array([0.1, -0.9, -0.2])
    up /= np.linalg.norm(up)
    T = FloorPlane((float(up[0]), float(up[1]), float(up[2])), -1.4, "floor plane").T_floor_world
    assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3)) and np.linalg.det(T[:3, :3]) > 0
    assert np.allclose(T[:3, :3] @ up, [0, 0, 1])
    on_floor = -1.4 * up
    assert np.allclose(T[:3, :3] @ on_floor + T[:3, 3], 0)
    ahead = T[:3, :3] @ [0, 0, 1]
    assert ahead[0] > 0.9 and abs(ahead[1]) < 1e-9


def test_a_camera_that_looks_straight_down_has_a_frame_too():
    T = FloorPlane((0.0, 0.0, -1.0), -2.0, "--up").T_floor_world
    assert np.allclose(T[:3, :3] @ [0, 0, -1], [0, 0, 1])
    assert np.allclose(T[:3, :3] @ [0, -1, 0], [1, 0, 0])  # the image's up is ahead


@pytest.mark.parametrize("up", [(0, 0, 0), (np.nan, 0, 1)])
def test_up_that_is_no_direction_is_refused(views, up):
    with pytest.raises(UserError, match=r"--up .*: expected a direction"):
        find_floor(views, room_frames()[0].camera, np.array(up))


def test_views_without_depth_are_refused(camera):
    for views in ([], [(wall(0.0), np.eye(4))]):
        with pytest.raises(UserError, match="no view has depth"):
            find_floor(views, camera)
