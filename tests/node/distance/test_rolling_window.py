"""A window that follows a camera, in front of walls and in the small built-in room."""

from typing import Any

import numpy as np
import pytest

from hsslam_node.distance.floor_plane import FloorPlane
from hsslam_node.distance.grid_map import CELL_FREE, CELL_OCCUPIED, grid_map
from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.rolling_window import RollingWindow
from hsslam_node.distance.states import FREE, OCCUPIED, UNKNOWN
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.inertial.gravity import Gravity
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from tests.node.distance.conftest import wall
from tests.small_room import OPTIONS, room_frames, room_poses

_UPRIGHT = np.array(  # z up, x ahead, of a camera at a height of 1.3 m that looks ahead
    [[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1.3], [0, 0, 0, 1]]
)


def _store(camera) -> KeyframeStore:
    return KeyframeStore.create(MemoryAllocator(), camera, 1000.0, 128)


def _append(
    store: KeyframeStore, depth_m: np.ndarray, T_world_cam: np.ndarray, fragment: int = 0
) -> int:
    color = np.zeros((*depth_m.shape, 3), np.uint8)
    depth_raw = np.round(1000 * depth_m).astype(np.uint16)
    k = store.count
    frame = Frame(k, k, store.camera, color, depth_raw, 1000.0)
    return store.append(frame, T_world_cam, fragment=fragment)


def _at(known: Occupancy, *points: tuple[float, float, float]) -> list[int]:
    """States at points, m, world."""
    T = known.T_grid_world
    places = np.array(points) @ T[:3, :3].T + T[:3, 3]
    return known.states()[tuple(known.grid.indices(places).T)].tolist()


def _shifted(x_m: float) -> np.ndarray:
    return se3_exp(np.array([x_m, 0, 0, 0, 0, 0]))


@pytest.fixture
def store(camera) -> KeyframeStore:
    """One keyframe in front of a wall that is 2.02 m away."""
    store = _store(camera)
    _append(store, wall(2.02), np.eye(4))
    return store


@pytest.fixture
def window(store) -> RollingWindow:
    store.world_frame.note_level(_UPRIGHT)
    return RollingWindow(store)


def test_it_has_the_axes_that_it_is_given_and_its_lowest_voxels_below_the_floor(window, camera):
    known = window.take(wall(2.02), camera, np.eye(4), 0)
    assert window.floor is not None and window.floor.source == "--base-T-camera"
    np.testing.assert_allclose(known.T_grid_world[:3, :3], _UPRIGHT[:3, :3])
    assert known.grid.shape == (200, 200, 50)
    assert known.grid.low[2] == pytest.approx(-0.125, abs=0.03)


def test_up_is_against_gravity_once_that_is_known(store, camera):
    window = RollingWindow(store)
    window.take(wall(2.02), camera, np.eye(4), 0)
    assert window.floor is not None and window.floor.source == "camera poses"
    store.world_frame.note_gravity(Gravity((0.0, -0.96, -0.28), 0.001))
    known = window.take(wall(2.02), camera, np.eye(4), 0)
    found = window.floor
    assert found.source == "gravity"
    np.testing.assert_allclose(known.T_grid_world[2, :3], [0.0, -0.96, -0.28], atol=1e-9)
    window.take(wall(2.02), camera, np.eye(4), 0)
    assert window.floor is found


def test_a_chair_that_is_carried_away_is_gone_within_a_second_of_updates(window, camera):
    with_chair = wall(2.02)
    with_chair[40:80, 60:100] = 1.22
    for _ in range(50):
        known = window.take(with_chair, camera, np.eye(4), 0)
    assert _at(known, (0, 0, 1.225)) == [OCCUPIED]
    for _ in range(10):
        known = window.take(wall(2.02), camera, np.eye(4), 0)
    assert _at(known, (0, 0, 1.225), (0, 0, 1.5), (0, 0, 2.025)) == [FREE, FREE, OCCUPIED]


def test_it_follows_the_camera_and_forgets_what_it_leaves(window, camera):
    window.take(wall(2.02), camera, np.eye(4), 0)
    for x_m in np.arange(0.0, 8.0, 0.5):
        known = window.take(wall(2.02), camera, _shifted(x_m), 0)
    place = known.grid.indices((_UPRIGHT @ [7.5, 0, 0, 1])[None, :3])[0]
    assert (np.abs(place[:2] - 100) <= 26).all()  # it moves in steps of an eighth
    assert _at(known, (7.5, 0, 2.025), (4.0, 0, 2.025)) == [OCCUPIED, OCCUPIED]
    column = known.grid.indices((_UPRIGHT @ [0, 0, 2.025, 1])[None, :3])[0]
    assert not known.grid.holds(column[None])[0]


def test_a_correction_moves_what_was_marked(camera):
    """The keyframes turn out to stand 40 cm aside and 20 cm back."""
    half = wall(2.02)
    half[:, 80:] = 3.0  # the wall ends at x = 0
    store = _store(camera)
    store.world_frame.note_level(_UPRIGHT)
    k = [_append(store, half, np.eye(4)) for _ in range(2)][-1]
    window = RollingWindow(store)
    for _ in range(4):
        known = window.take(half, camera, np.eye(4), k)
    assert _at(known, (-0.1, 0, 2.025), (0.1, 0, 2.025)) == [OCCUPIED, FREE]
    T = np.eye(4)
    T[:3, 3] = 0.4, 0, -0.2
    version = store.pose_version
    store.correct_poses(np.arange(2), np.stack([T, T]))
    for _ in range(4):  # frames that were tracked before the correction
        known = window.take(half, camera, np.eye(4), k, version)
        assert _at(known, (-0.1, 0, 2.025)) == [UNKNOWN]
    known = window.take(half, camera, T, k, store.pose_version)
    assert _at(known, (0.3, 0, 1.825), (0.5, 0, 1.825)) == [OCCUPIED, FREE]
    assert _at(known, (-0.1, 0, 2.025)) == [UNKNOWN]  # behind the wall of now


def test_a_person_who_came_since_the_last_keyframe_is_there_after_a_correction(
    window, store, camera
):
    with_person = wall(2.02)
    with_person[40:80, 60:100] = 1.22
    for _ in range(3):
        known = window.take(with_person, camera, np.eye(4), 0)
    assert _at(known, (0, 0, 1.225)) == [OCCUPIED]
    T = _shifted(0.2)
    store.correct_poses(np.array([0]), T[None])
    known = window.take(with_person, camera, T, 0, store.pose_version)
    assert _at(known, (0.2, 0, 1.225), (0.2, 0, 1.0)) == [OCCUPIED, FREE]


def test_what_keyframes_left_out_as_moving_is_there_after_a_correction(window, store, camera):
    """The camera sees a new object for 0.6 s, then turns away; its keyframes have no depth there for 2 s."""
    with_object = wall(2.02)
    with_object[40:80, 60:100] = 1.22
    masked = with_object.copy()
    masked[36:84, 56:104] = 0.0
    away = se3_exp(np.array([0, 0, 0, 0, np.pi, 0]))
    for n in range(20):
        view, T = (with_object, np.eye(4)) if n < 6 else (wall(2.02), away)
        k = _append(store, masked if n < 6 else view, T)
        known = window.take(view, camera, T, k)
    assert _at(known, (0, 0, 1.225)) == [OCCUPIED]
    T = _shifted(0.2)
    moved = [T] * 7 + [T @ away] * 14
    store.correct_poses(np.arange(21), np.stack(moved))
    known = window.take(wall(2.02), camera, T @ away, 20, store.pose_version)
    assert _at(known, (0.2, 0, 1.225), (0.2, 0, 1.0)) == [OCCUPIED, FREE]


@pytest.mark.parametrize(("width_px", "height_px"), [(640, 480), (848, 480), (1280, 721)])
def test_a_large_image_is_marked_anew_as_it_was_marked(width_px, height_px):
    """From the pixels that are looked at, which are all that the window keeps."""
    f = 0.9 * width_px
    camera = Camera(width_px, height_px, f, f, width_px / 2 - 0.3, height_px / 2 + 0.7)
    rows, columns = np.mgrid[:height_px, :width_px] / width_px
    depth_m = (2.0 + 0.5 * columns - 0.3 * rows).astype(np.float32)
    store = _store(camera)
    behind = se3_exp(np.array([0, 0, 0, 0, np.pi, 0]))
    _append(store, depth_m, behind)
    store.world_frame.note_level(_UPRIGHT)
    window = RollingWindow(store)
    for _ in range(3):
        known = window.take(depth_m, camera, np.eye(4), 0)
    before, first = known.states().copy(), known.grid.first
    T = _shifted(0.5)  # whole voxels
    store.correct_poses(np.array([0]), (T @ behind)[None])
    known = window.take(np.zeros_like(depth_m), camera, T, 0, store.pose_version)
    aside = np.subtract(known.grid.first, first)
    np.testing.assert_array_equal(np.abs(aside), [0, 10, 0])
    assert (before == OCCUPIED).sum() > 1000
    assert (known.states() != before).mean() < 1e-4  # rounding


def test_a_person_whom_newer_keyframes_do_not_see_is_gone_after_a_correction(window, store, camera):
    with_person = wall(2.02)
    with_person[40:80, 60:100] = 1.22
    for _ in range(3):
        window.take(with_person, camera, np.eye(4), 0)
    for _ in range(6):  # while no frame came, as of a fragment that joins
        _append(store, wall(2.02), np.eye(4))
    T = _shifted(0.2)
    store.correct_poses(np.arange(7), np.stack([T] * 7))
    known = window.take(wall(0.0), camera, T, 6, store.pose_version)
    assert _at(known, (0.2, 0, 1.225), (0.2, 0, 2.025)) == [FREE, OCCUPIED]


def test_a_frame_that_a_correction_overtakes_is_not_marked_anew(window, store, camera, monkeypatch):
    known = window.take(wall(2.02), camera, np.eye(4), 0, store.pose_version)
    observe = Occupancy.observe

    def corrected_meanwhile(self: Occupancy, *args: Any) -> None:
        observe(self, *args)
        monkeypatch.undo()
        store.correct_poses(np.array([0]), _shifted(0.2)[None])

    monkeypatch.setattr(Occupancy, "observe", corrected_meanwhile)
    window.take(wall(1.0), camera, np.eye(4), 0, store.pose_version)
    known = window.take(wall(2.02), camera, _shifted(0.2), 0, store.pose_version)
    assert _at(known, (0.2, 0, 1.025), (0.2, 0, 2.025)) == [FREE, OCCUPIED]


def test_on_another_storey_the_box_is_on_its_floor(window, store, camera):
    def at(storey: int) -> np.ndarray:
        T = np.eye(4)
        T[1, 3] = -3.0 * storey  # y is down
        return T

    for _ in range(20):  # so that a new keyframe is no reason to look for the floor
        _append(store, wall(2.02), at(0))
    window.take(wall(2.02), camera, at(0), 0)
    ids = {0: 0} | {n: _append(store, wall(2.02), at(n)) for n in (1, 2)}
    for storey in (1, 2, 1, 0):
        known = window.take(wall(2.02), camera, at(storey), ids[storey])
        y = -3.0 * storey
        assert _at(known, (0, y, 2.025), (0, y, 1.0)) == [OCCUPIED, FREE], storey
        others = [(0, -3.0 * other, 2.025) for other in {0, 1, 2} - {storey}]
        T = known.T_grid_world
        places = np.array(others) @ T[:3, :3].T + T[:3, 3]
        assert not known.grid.holds(known.grid.indices(places)).any()


def test_a_small_correction_leaves_the_marks(window, store, camera):
    known = window.take(wall(2.02), camera, np.eye(4), 0)
    store.correct_poses(np.array([0]), _shifted(0.01)[None])
    assert window.take(wall(2.02), camera, _shifted(0.01), 0) is known


def test_a_new_window_knows_what_keyframes_about_it_saw(camera):
    """As after a restart; keyframes that stand elsewhere are left out."""
    store = _store(camera)
    store.world_frame.note_level(_UPRIGHT)
    for x_m in (0.0, 1.0, 20.0):
        _append(store, wall(2.02), _shifted(x_m))
        _append(store, wall(2.02), _shifted(x_m))
    known = RollingWindow(store).take(wall(0.0), camera, np.eye(4), -1)
    assert _at(known, (0.0, 0, 2.025), (1.0, 0, 2.025)) == [OCCUPIED, OCCUPIED]


def test_the_floor_of_a_room_is_found_and_its_cells_are_free():
    frames, poses = room_frames(), room_poses()
    store = KeyframeStore.create(
        MemoryAllocator(), frames[0].camera, frames[0].depth_units_per_m, 64
    )
    window = RollingWindow(store)
    for k in range(0, 40, 2):
        if k % 4 == 0:
            store.append(frames[k], poses[k])
        known = window.take(frames[k].depth_m(), frames[k].camera, poses[k], store.count - 1)
    assert window.floor is not None and window.floor.source == "floor plane"
    grid = grid_map(known)
    assert (grid.cells == CELL_FREE).sum() > 300 and (grid.cells == CELL_OCCUPIED).sum() > 50
    ahead = known.T_grid_world @ poses[-1] @ [0, 0, 0.8, 1]
    assert grid.cells_at(ahead[None, :2]).tolist() == [CELL_FREE]


def _room_window(T_level_world: np.ndarray, gravity: Gravity | None = None) -> RollingWindow:
    """Over five keyframes of the small room, whose camera looks down by 12 degrees."""
    frames, poses = room_frames(), room_poses()
    first = frames[0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 64)
    store.world_frame.note_level(T_level_world)
    if gravity is not None:
        store.world_frame.note_gravity(gravity)
    for k in range(0, 40, 8):
        store.append(frames[k], poses[k])
    window = RollingWindow(store)
    window.take(first.depth_m(), first.camera, poses[0], -1)
    return window


def test_a_robot_frame_that_is_not_level_is_told_by_floor_and_gravity():
    truth = open_ground_truth("synth:room", OPTIONS)
    assert truth
    x, y, z = (float(part) for part in truth.T_world_cam[0, 2, :3])
    gravity, ahead = Gravity((x, y, z), 0.001), RobotFrames().T_base_cam
    for known, source in ((None, "floor plane"), (gravity, "gravity")):
        assumed = _room_window(ahead, known)
        assert assumed.floor is not None and assumed.floor.source == "level camera"
        told = f"direction up by level camera is 12 degrees off that by {source}: expected --base-T"
        assert assumed.tilt is not None and assumed.tilt.startswith(told)
        level = _room_window(FloorPlane((x, y, z), 0.0, "--up").T_floor_world, known)
        assert level.floor is not None and level.floor.source == "--base-T-camera"
        assert level.tilt is None


def test_a_place_that_the_window_comes_to_again_is_filled_from_its_keyframes(window, store, camera):
    wall_of_first = (0.0, 0.0, 2.02)
    known = window.take(wall(2.02), camera, np.eye(4), 0)
    assert _at(known, wall_of_first) == [OCCUPIED]
    far = _append(store, wall(2.02), _shifted(12.0))
    known = window.take(wall(2.02), camera, _shifted(12.0), far)
    window.take(wall(2.02), camera, _shifted(6.0), far)
    known = window.take(np.zeros((120, 160), np.float32), camera, _shifted(2.0), far)
    assert _at(known, wall_of_first) == [OCCUPIED]


def test_keyframes_that_join_with_a_fragment_fill_the_window(window, store, camera):
    window.take(wall(2.02), camera, np.eye(4), 0)
    behind = se3_exp(np.array([0, 0, 0, 0, np.pi, 0]))
    _append(store, wall(2.02), behind, fragment=1)
    known = window.take(wall(2.02), camera, np.eye(4), 0)
    assert _at(known, (0.0, 0.0, -2.02), (0.0, 0.0, -1.0)) == [OCCUPIED, FREE]


def test_a_correction_keeps_places_that_only_old_keyframes_show(camera):
    """More keyframes than a window is marked from; only the first looks back."""
    store = _store(camera)
    behind = se3_exp(np.array([0, 0, 0, 0, np.pi, 0]))
    _append(store, wall(1.52), behind)
    for _ in range(100):
        _append(store, wall(2.02), np.eye(4))
    store.world_frame.note_level(_UPRIGHT)
    window = RollingWindow(store)
    known = window.take(wall(2.02), camera, np.eye(4), 100)
    assert _at(known, (0.0, 0.0, -1.52), (0.0, 0.0, -1.0)) == [OCCUPIED, FREE]
