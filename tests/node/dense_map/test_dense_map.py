"""What the map of the small room says of places, rays and bodies, against the room's true surface."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import torch

from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.keyframes import keyframes_of_store
from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.dense_map.shapes import Spheres
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_metrics import distances
from hsslam_node.geometry.projection import pixel_rays, world_points
from hsslam_node.map.checkpoint import save_checkpoint
from tests.node.dense_map.room_map import map_of, room_map
from tests.small_room import OPTIONS, SMALL, mapped_room, room_frames, room_poses


def _true_distance_m(points: np.ndarray) -> np.ndarray:
    truth = open_ground_truth("synth:room", OPTIONS)
    mesh = truth.mesh() if truth else None
    assert truth is not None and mesh is not None
    T = truth.T_world_cam[0]
    return distances(points @ T[:3, :3].T + T[:3, 3], mesh.vertices, mesh.faces)


def _measured(k: int) -> np.ndarray:
    """Points [N, 3] m that frame k measured."""
    frame = room_frames()[k]
    return world_points(frame.depth_m(), frame.camera, room_poses()[k], 4)


def test_depth_that_was_not_mapped_shows_no_surface_in_a_saved_map(tmp_path):
    room = mapped_room()
    config = replace(SMALL, mapper=replace(SMALL.mapper, max_depth_m=2.0))
    save_checkpoint(tmp_path / "m.safetensors", map_snapshot(room.store, room.parameters, config))
    near = SavedMap.open(tmp_path / "m.safetensors", "cpu")

    def farthest_m(dense_map: DenseMap) -> float:
        vertices = np.asarray(dense_map.mesh(0.1).vertices)
        away_m = np.linalg.norm(vertices[:, None] - room.store.poses()[:, :3, 3], axis=2)
        return float(away_m.min(axis=1).max())

    assert 1.0 < farthest_m(near) < 3.0 < farthest_m(room_map())
    assert near.query(_measured(6)).known.mean() < room_map().query(_measured(6)).known.mean()


def test_processes_of_a_pool_get_the_same_map(tmp_path):
    room = mapped_room()
    save_checkpoint(tmp_path / "m.safetensors", map_snapshot(room.store, room.parameters, SMALL))
    saved = SavedMap.open(tmp_path / "m.safetensors", "cpu", far_m=2.0)
    points = np.concatenate([_measured(6)[::7], [[0.0, 0.0, 40.0]]])
    expected = saved.query(points)
    (tmp_path / "m.safetensors").unlink()
    answers = pickle.loads(pickle.dumps(saved)).query(points)
    for got, wanted in zip(answers, expected, strict=True):
        assert np.array_equal(got, wanted, equal_nan=True)


def test_what_a_map_shares_with_its_caller_cannot_be_overwritten(tmp_path):
    room = mapped_room()
    save_checkpoint(tmp_path / "m.safetensors", map_snapshot(room.store, room.parameters, SMALL))
    saved = SavedMap.open(tmp_path / "m.safetensors", "cpu")
    for keyframes in (saved.keyframes, room_map().keyframes):
        for array in (keyframes.ids, keyframes.stamps_ns, keyframes.T_world_cam):
            assert not array.flags.writeable
    assert not room_map().distances().to_unknown_m.flags.writeable


def test_distance_is_zero_at_what_a_frame_measured_and_grows_towards_the_camera():
    surface, eye = _measured(6), room_poses()[6][:3, 3]
    ray = surface - eye
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    at, before = room_map().query(surface), room_map().query(surface - 0.04 * ray)
    assert at.known.mean() > 0.98 and before.known.mean() > 0.98
    assert np.nanmedian(np.abs(at.distance_m)) < 0.01
    assert (before.distance_m > at.distance_m).mean() > 0.95
    true = _true_distance_m(surface - 0.04 * ray)
    assert np.nanmedian(np.abs(before.distance_m - true)) < 0.01


def test_gradient_is_of_unit_length_and_the_way_from_the_surface():
    surface, eye = _measured(6), room_poses()[6][:3, 3]
    ray = surface - eye
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    points = surface - 0.02 * ray
    found = room_map().query(points)
    length = np.linalg.norm(found.gradient, axis=1)
    np.testing.assert_allclose(length[length > 0], 1.0, atol=1e-5)
    assert (length > 0).mean() > 0.9
    step_m = 0.01
    farther = _true_distance_m(points + step_m * found.gradient) - _true_distance_m(points)
    assert np.median(farther[length > 0]) > 0.9 * step_m  # 26 degrees


def test_far_from_surfaces_the_distance_is_to_what_keyframes_measured():
    rng = np.random.default_rng(0)
    eye = room_poses()[0][:3, 3]
    points = eye + rng.uniform((-0.4, -0.4, 0.3), (0.4, 0.4, 1.2), (400, 3))
    found, true = room_map().query(points), _true_distance_m(points)
    far = found.known & (true > 0.15) & (found.distance_m < 2.0)
    assert far.sum() > 100
    error_m = found.distance_m[far] - true[far]
    assert np.median(np.abs(error_m)) < 0.04
    length = np.linalg.norm(found.gradient[far], axis=1)
    np.testing.assert_allclose(length, 1.0, atol=1e-5)
    step_m = 0.02
    ahead = _true_distance_m(points + step_m * found.gradient)
    assert np.median((ahead - true)[far]) > 0.9 * step_m


def test_distances_pass_over_from_field_to_keyframes_without_a_step():
    surface, eye = _measured(6), room_poses()[6][:3, 3]
    ray = (eye - surface) / np.linalg.norm(eye - surface, axis=1, keepdims=True)
    steps = np.arange(0.0, 0.2, 0.002)
    along = (surface[::40, None] + steps[:, None] * ray[::40, None]).reshape(-1, 3)
    distance_m = room_map().query(along).distance_m.reshape(-1, len(steps))
    jump_m = np.abs(np.diff(distance_m, axis=1))
    assert np.nanquantile(jump_m, 0.99) < 0.02
    assert np.nanmean(distance_m[:, -1]) > 0.1


def test_free_space_beside_walls_is_seldom_taken_for_a_surface():
    surface, eye = _measured(6), room_poses()[6][:3, 3]
    ray = (eye - surface) / np.linalg.norm(eye - surface, axis=1, keepdims=True)
    points = surface + 0.1 * ray
    found, true = room_map().query(points), _true_distance_m(points)
    away = found.known & (true > 0.07)
    assert away.sum() > 500
    assert ((found.distance_m - true)[away] < -0.03).mean() < 0.05


def test_nothing_is_known_behind_walls_and_beyond_theroom_map():
    surface, eye = _measured(0), room_poses()[0][:3, 3]
    ray = (surface - eye) / np.linalg.norm(surface - eye, axis=1, keepdims=True)
    behind = room_map().query(surface + 0.5 * ray)
    assert behind.known.mean() < 0.1
    assert not behind.certainty[~behind.known].any()
    np.testing.assert_array_equal(np.isnan(behind.distance_m), ~behind.known)
    beyond = room_map().query(np.array([[0.0, 0.0, 500.0], [1e6, 0.0, 0.0]]))
    assert not beyond.known.any() and not beyond.gradient.any()


def test_rays_end_where_the_frame_measured():
    surface, eye = _measured(6), room_poses()[6][:3, 3]
    directions = 3.0 * (surface - eye)
    hits = room_map().raycast(np.broadcast_to(eye, surface.shape), directions, 20.0)
    true = np.linalg.norm(surface - eye, axis=1)
    assert hits.hit.mean() > 0.95
    assert np.median(np.abs(hits.distance_m - true)[hits.hit]) < 0.01
    assert np.isinf(hits.distance_m[~hits.hit]).all()
    short = room_map().raycast(np.broadcast_to(eye, surface.shape), directions, 0.5)
    assert (short.hit == (hits.distance_m <= 0.5)).mean() > 0.99
    assert not short.hit.all()
    far = room_map().raycast([[0, 0, -1e15], [0, 0, 0]], [[0, 0, 1], [0, 0, 1]], np.inf)
    assert far.hit.tolist() == [False, True] and np.isinf(far.distance_m[0])


def test_no_sphere_that_is_free_touches_the_room():
    rng = np.random.default_rng(0)
    surface, eye = _measured(6), room_poses()[6][:3, 3]
    share = rng.uniform(0.3, 1.0, (len(surface), 1))
    centres = (eye + share * (surface - eye))[:300]
    free = room_map().is_free(Spheres(centres, 0.1))
    gap_m = _true_distance_m(centres) - 0.1
    assert not free[gap_m < -0.01].any()
    known = room_map().query(centres).known
    assert free[(gap_m > 0.04) & known].mean() > 0.5
    assert free.any() and not free.all()


def test_a_surface_that_keyframes_saw_through_later_is_gone():
    """Ten more looks of a keyframe find all that it shows 12 cm farther away; the field keeps it."""
    room, k = mapped_room(), 1  # frame 4
    whole = keyframes_of_store(room.store)
    before = replace(
        whole, ids=whole.ids[[k]], stamps_ns=whole.stamps_ns[[k]], T_world_cam=whole.T_world_cam[[k]],
        depth_m=lambda _: whole.depth_m(k),
    )  # fmt: skip
    after = replace(
        before, ids=np.arange(11), stamps_ns=before.stamps_ns.repeat(11),
        T_world_cam=before.T_world_cam.repeat(11, axis=0),
        depth_m=lambda n: whole.depth_m(k) + np.float32(0.12 * (n > 0)),
    )  # fmt: skip
    there, gone = map_of(before), map_of(after)
    surface, eye = _measured(4), room_poses()[4][:3, 3]
    ray = (surface - eye) / np.linalg.norm(surface - eye, axis=1, keepdims=True)
    across = -np.einsum("ni,ni->n", there.query(surface - 0.02 * ray).gradient, ray) > 0.8
    surface, ray = surface[across], ray[across]
    points, origins = surface - 0.02 * ray, np.broadcast_to(eye, surface.shape)
    assert np.median(there.query(points).distance_m) < 0.03 < 0.08
    assert np.median(gone.query(points).distance_m) > 0.08
    length_m = np.linalg.norm(surface - eye, axis=1)

    def ends_there(one_map: DenseMap) -> np.ndarray:
        return np.abs(one_map.raycast(origins, ray).distance_m - length_m) < 0.04

    def shows_it(one_map: DenseMap) -> np.ndarray:
        depth_m = one_map.render(room_poses()[4], from_keyframes=False)[1]
        measured_m = whole.depth_m(k)
        return np.abs(depth_m - measured_m)[measured_m > 0] < 0.04

    assert ends_there(there).mean() > 0.9 and ends_there(gone).mean() < 0.3
    assert shows_it(there).mean() > 0.9 and shows_it(gone).mean() < 0.3
    balls = Spheres(points[::20], 0.03)
    assert there.is_free(balls).mean() < 0.1 and gone.is_free(balls).mean() > 0.5


def test_rays_end_at_a_surface_that_keyframes_measured_and_the_field_lacks():
    """Six looks of a keyframe find a board 40 cm in front of the middle of its view."""
    room, k = mapped_room(), 1  # frame 4
    whole = keyframes_of_store(room.store)
    board = np.s_[40:80, 55:105]

    def depth_m(_: int) -> np.ndarray:
        shown_m = whole.depth_m(k).copy()
        shown_m[board] = shown_m[board].min() - np.float32(0.4)
        return shown_m

    seen = replace(
        whole, ids=np.arange(6), stamps_ns=whole.stamps_ns[[k]].repeat(6),
        T_world_cam=whole.T_world_cam[[k]].repeat(6, axis=0), depth_m=depth_m,
    )  # fmt: skip
    T, camera = whole.T_world_cam[k], whole.camera
    v, u = np.mgrid[45:75:5, 60:100:5].reshape(2, -1)
    rays = pixel_rays(u, v, camera) * depth_m(0)[v, u, None]
    directions = rays @ T[:3, :3].T
    origins = np.broadcast_to(T[:3, 3], directions.shape)
    length_m = np.linalg.norm(directions, axis=1)
    ends_m = map_of(seen).raycast(origins, directions).distance_m
    assert (np.abs(ends_m - length_m) < 0.05).mean() > 0.95
    ends_m = map_of(whole).raycast(origins, directions).distance_m
    assert (ends_m > length_m + 0.2).all()


def test_its_mesh_lies_on_the_true_surface_and_its_trajectory_is_of_the_keyframes():
    mesh = room_map().mesh(0.05)
    assert len(mesh.faces) > 1000
    assert np.median(_true_distance_m(np.asarray(mesh.vertices))) < 0.01
    trajectory = room_map().trajectory()
    np.testing.assert_array_equal(trajectory.T_world_cam, room_poses()[::4])
    assert list(trajectory.stamps_ns) == [f.stamp_ns for f in room_frames()[::4]]
    trajectory.T_world_cam[:, :3, 3] -= 5.0  # a copy: the map stays
    trajectory.stamps_ns[:] = 0
    np.testing.assert_array_equal(room_map().trajectory().T_world_cam, room_poses()[::4])
    assert room_map().trajectory().stamps_ns.any()


@pytest.mark.parametrize(
    ("ask", "text"),
    [
        (lambda m: m.query([1.0, 2.0, 3.0]), r"points \[1.0, 2.0, 3.0\]: expected finite numbers"),
        (lambda m: m.query([[0, np.nan, 0]]), "points .*nan.*: expected finite numbers"),
        (lambda m: m.query([["a", "b", "c"]]), r"points \[\['a', 'b', 'c'\]\]: expected finite"),
        (
            lambda m: m.query([[1, 2, 3], [4, 5]]),
            r"points \[\[1, 2, 3\], \[4, 5\]\]: expected finite",
        ),
        (lambda m: m.query([[10**400, 0, 0]]), "points .*: expected finite numbers"),
        (lambda m: m.query(torch.ones((1, 3), requires_grad=True)), "points tensor.*: expected"),
        (lambda m: m.is_free([[0, 0, 1]]), "shapes is a list: expected Spheres or Boxes"),
        (lambda m: m.render(np.eye(4), np.eye(3)), "camera is a ndarray: expected a Camera"),
        (lambda m: m.render("pose"), "T_world_cam 'pose': expected a transform"),
        *(
            (
                lambda m, far=far: m.raycast([[0, 0, 0]], [[0, 0, 1]], far),
                f"max_m = {far}: expected",
            )
            for far in (np.nan, -1)
        ),
        (lambda m: m.raycast([[0, 0, 0]], [[0, 0, 0]]), "directions .*none of length 0"),
        (lambda m: m.raycast([[0, 0, 0]], np.ones((2, 3))), "expected one for each of 1 origins"),
        (lambda m: m.render(np.eye(4)[:3]), r"T_world_cam \[3, 4\]: expected a transform"),
        *(
            (lambda m, T=T: m.render(T), "T_world_cam .*of a rotation and a translation")
            for T in (np.diag([2.0, 2, 2, 1]), np.diag([-1.0, 1, 1, 1]), np.zeros((4, 4)))
        ),
        (lambda m: m.render(np.full((4, 4), np.nan)), "T_world_cam .*expected a transform"),
        (
            lambda m: m.render(np.eye(4), replace(m.camera, distortion=(0.3, 0.0, 0.0, 0.0))),
            r"camera.distortion = \[0.3, 0.0, 0.0, 0.0\]: expected a camera without a lens",
        ),
        *((lambda m, v=v: m.mesh(v), "voxel_m = .*above 0") for v in (0.0, np.nan, np.inf, "0.1")),
        (lambda m: m.mesh(1e-9), "voxel_m = 1e-09: expected at least .* m in a map of this size"),
        (lambda m: m.mesh(1e-300, everywhere=True), "voxel_m = 1e-300: expected at least"),
    ],
)
def test_bad_questions_are_one_line(ask, text):
    with pytest.raises(UserError, match=text):
        ask(room_map())


@pytest.mark.parametrize("far_m", [0.0, -1.0, np.nan, "4"])
def test_a_reach_that_is_none_is_told_when_the_map_is_opened(far_m):
    keyframes = keyframes_of_store(mapped_room().store)
    with pytest.raises(UserError, match=f"far_m = {far_m!r}: expected metres above 0"):
        map_of(keyframes, far_m=far_m)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), []])
def test_no_points_have_no_answers(points):
    assert [len(part) for part in room_map().query(points)] == [0, 0, 0, 0]
    assert [len(part) for part in room_map().raycast(points, points)] == [0, 0]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("far_m", [1e20, 1e39, 1e300])
def test_numbers_of_any_size_are_taken(far_m):
    assert not room_map().query([[far_m, 0, 0]]).known
    assert not room_map().raycast([[far_m, 0, 0]], [[0, 0, 1]]).hit
    hits = room_map().raycast([[0, 0, 0]] * 3, [[0, 0, 1], [0, 0, far_m], [0, 0, 1 / far_m]])
    assert hits.hit.all() and np.ptp(hits.distance_m) == 0
