"""`hsslam-map grid` and `esdf` on a map of the small room, against what its keyframes saw."""

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml as yaml_file
from scipy.spatial.transform import Rotation

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.distance.esdf_file import read_esdf
from hsslam_node.distance.grid_map import CELL_FREE, CELL_OCCUPIED, grid_map
from hsslam_node.distance.rolling_window import RollingWindow
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import inverse
from hsslam_node.inertial.gravity import Gravity
from hsslam_node.map.checkpoint import load_checkpoint, save_checkpoint
from hsslam_services.commands.maps.command import main
from hsslam_services.run.options import ServeOptions
from tests.small_room import OPTIONS, SMALL, mapped_room, room_frames, room_poses


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory) -> Path:
    room = mapped_room()
    folder = tmp_path_factory.mktemp("run")
    checkpoint = map_snapshot(room.store, room.parameters, SMALL)
    save_checkpoint(folder / "map.safetensors", checkpoint)
    return folder


def _true_up() -> np.ndarray:
    truth = open_ground_truth("synth:room", OPTIONS)
    assert truth
    return truth.T_world_cam[0, :3, :3].T @ [0.0, 0.0, 1.0]


def test_up_is_against_gravity_if_the_map_knows_it(run_folder, tmp_path, capsys):
    x, y, z = _true_up().tolist()
    known = replace(
        load_checkpoint(run_folder / "map.safetensors"), gravity=Gravity((x, y, z), 0.001)
    )
    save_checkpoint(tmp_path / "known.safetensors", known)
    out = str(tmp_path / "map.yaml")
    assert main(["grid", str(tmp_path / "known.safetensors"), "-o", out]) == 0
    assert (
        f"direction up by gravity: {x:.3f} {y:.3f} {z:.3f}; the floor at "
        in capsys.readouterr().out
    )


def test_a_name_that_yaml_cannot_hold_is_refused_in_one_line(run_folder, tmp_path, capsys):
    out = os.fsdecode(os.fsencode(tmp_path) + b"/n\xff.yaml")
    assert main(["grid", str(run_folder), "-o", out]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1 and "\\udcff.yaml': expected a name in UTF-8" in told[0]
    assert not list(tmp_path.iterdir())


def _looks_left() -> tuple[float, ...]:
    """`--base-T-camera` of the room's camera, tilted as it is, on the left side of a robot."""
    up = _true_up()
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up  # the camera's right
    ahead /= np.linalg.norm(ahead)
    R_base_cam = np.stack([ahead, np.cross(up, ahead), up])
    return (0.3, 0.1, 0.35, *Rotation.from_matrix(R_base_cam).as_quat().tolist())


@pytest.mark.parametrize("is_kept", [True, False])
def test_the_grid_of_a_robot_is_that_of_its_run_and_in_the_frame_of_ros(
    run_folder, tmp_path, capsys, is_kept
):
    options = ServeOptions(base_T_camera=_looks_left())
    room, path, out = mapped_room(), tmp_path / "map.safetensors", tmp_path / "map.yaml"
    kept = options.T_level_world if is_kept else None
    save_checkpoint(path, replace(load_checkpoint(run_folder / path.name), T_level_world=kept))
    given = () if is_kept else ("--base-T-camera", *map(str, options.base_T_camera))
    assert main(["grid", str(path), "-o", str(out), *given]) == 0
    assert "direction up by --base-T-camera: " in capsys.readouterr().out
    room.store.world_frame.note_level(options.T_level_world)
    window = RollingWindow(room.store)
    for frame, T in zip(room_frames()[::4], room_poses()[::4], strict=True):
        known = window.take(frame.depth_m(), frame.camera, T, -1)
    live, robot = grid_map(known), RobotFrames.mounted(options.base_T_camera)
    T_map_base = robot.base_pose(room_poses()[20])  # as /tf has it
    T_live_base = live.T_floor_world @ room_poses()[20] @ inverse(robot.T_base_cam)
    np.testing.assert_allclose(T_live_base[:2], T_map_base[:2], atol=1e-9)
    x, y, _ = yaml_file.safe_load(out.read_text())["origin"]
    grey = np.flipud(cv2.imread(str(tmp_path / "map.pgm"), cv2.IMREAD_UNCHANGED))
    for value, cell in ((0, CELL_OCCUPIED), (254, CELL_FREE)):
        row, column = np.nonzero(grey == value)
        middles = np.stack([column, row], axis=1) * 0.05 + (x + 0.025, y + 0.025)
        assert len(row) > 50 and (live.cells_at(middles) == cell).mean() > 0.8


def test_the_grid_is_free_where_distances_say_so(run_folder, tmp_path, capsys):
    yaml, esdf = tmp_path / "map.yaml", tmp_path / "esdf.npz"
    up = [f"{part:.6f}" for part in _true_up()]
    heights = ["--from-height-m", "0.3", "--to-height-m", "1.2"]
    assert main(["grid", str(run_folder), "-o", str(yaml), "--up", *up, *heights]) == 0
    told, line = capsys.readouterr().out.splitlines()
    assert told.startswith("direction up by --up: ") and "; the floor at " in told
    assert line.startswith(f"{yaml}, map.pgm: ")
    assert main(["esdf", str(run_folder), "-o", str(esdf), "--up", *up, *heights]) == 0
    distances, floor = read_esdf(esdf)
    np.testing.assert_allclose(floor.up, _true_up(), atol=1e-5)
    low_m, high_m = distances.grid.low[2], distances.grid.high[2]
    assert (low_m, high_m) == pytest.approx((0.3, 1.2))
    picture = np.flipud(cv2.imread(str(tmp_path / "map.pgm"), cv2.IMREAD_UNCHANGED))
    assert picture.T.shape == distances.grid.shape[:2]
    is_occupied = (distances.states == 2).any(axis=2).T
    np.testing.assert_array_equal(picture == 0, is_occupied)
    assert (picture == 254).sum() > 100 and is_occupied.sum() > 50


def test_distances_in_the_file_are_those_of_the_map(run_folder, tmp_path):
    path = tmp_path / "esdf.npz"
    assert main(["esdf", str(run_folder / "map.safetensors"), "--out", str(path)]) == 0
    distances, _ = read_esdf(path)
    points = np.random.default_rng(0).uniform((-0.5, -0.5, 0.5), (0.5, 0.5, 1.5), (500, 3))
    in_file, asked = (
        distances.query(points),
        SavedMap.open(run_folder / "map.safetensors").query(points),
    )
    both = in_file.known & asked.known & (in_file.distance_m > 0.15)
    assert both.mean() > 0.5
    assert np.median(np.abs(in_file.distance_m - asked.distance_m)[both]) < 0.03


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("grid",), "grid: no map: expected a run folder or map.safetensors"),
        (("esdf", "/nowhere"), "/nowhere: no such file: expected a map"),
        (("grid", "m", "--up", "0", "0"), "--up 0 0: expected a direction X Y Z"),
        (("grid", "m", "--up", "0", "0", "0"), "--up 0 0 0: expected a direction X Y Z"),
        (("grid", "m", "--base-T-camera", "1", "2"), "--base-T-camera 1 2: expected 7 numbers"),
        (
            ("esdf", "m", "--up", *"001", "--base-T-camera", *"0000001"),
            "--up, --base-T-camera: both define up: expected one of them",
        ),
        (
            ("grid", "m", "--voxel", "0.4"),
            "--from-height-m 0.15: expected --voxel of at most 0.15",
        ),
        (("grid", "m", "--far-m", "0"), "--far-m 0.0: expected metres above 0, 12 at most"),
        (("esdf", "m", "--voxel", "0"), "--voxel 0.0: expected 0.01 to 0.5 m"),
        (("grid", "m", "--to-height-m", "0.1"), "--from-height-m 0.15 --to-height-m 0.1: expected"),
        (("esdf", "m", "--to-height-m", "nan"), "--to-height-m nan: expected from < to"),
    ],
)
def test_bad_input_is_one_line_and_code_2(arguments, text, capsys):
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert text in told and told.count("\n") == 1


def test_what_was_seen_from_far_alone_counts_if_that_is_wanted(run_folder, tmp_path):
    near, far = tmp_path / "near.npz", tmp_path / "far.npz"
    for path, far_m in ((near, "1.5"), (far, "4")):
        assert main(["esdf", str(run_folder), "-o", str(path), "--far-m", far_m]) == 0
    sizes = [np.count_nonzero(read_esdf(path)[0].states) for path in (near, far)]
    assert sizes[0] < 0.9 * sizes[1]


@pytest.mark.parametrize("command", ["grid", "esdf"])
def test_a_distance_at_which_nothing_was_seen_is_bad_input(run_folder, tmp_path, command, capsys):
    out = tmp_path / ("map.yaml" if command == "grid" else "esdf.npz")
    assert main([command, str(run_folder), "--out", str(out), "--far-m", "0.1"]) == 2
    assert "--far-m 0.1: no view has depth below 0.1 m" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["grid", "esdf"])
def test_voxels_too_fine_for_the_images_are_bad_input(run_folder, tmp_path, command, capsys):
    out = tmp_path / ("map.yaml" if command == "grid" else "esdf.npz")
    words = [command, str(run_folder), "--out", str(out), "--voxel", "0.02"]
    assert main(words) == 2
    told = capsys.readouterr().err
    expected = (
        "--voxel 0.02 --far-m 4: expected --voxel of at least 0.037, or --far-m of at most 2.187"
    )
    assert expected in told and told.count("\n") == 1
    assert not list(tmp_path.iterdir())
    assert main([*words, "--far-m", "2.187"]) == 0


def test_an_up_of_any_length_is_a_direction(run_folder, tmp_path):
    found = []
    for length in (1e-300, 1.0, 1e300):
        out = tmp_path / f"{length}.npz"
        up = [str(length * part) for part in _true_up()]
        assert main(["esdf", str(run_folder), "-o", str(out), "--up", *up]) == 0
        found.append(read_esdf(out)[1].up)
    np.testing.assert_allclose(found[::2], [found[1]] * 2, atol=1e-12)


@pytest.mark.parametrize(("command", "out"), [("grid", "map.png"), ("esdf", "/nowhere/x.npz")])
def test_an_output_of_another_kind_is_bad_input(run_folder, command, out, capsys):
    assert main([command, str(run_folder), "--out", out]) == 2
    assert f"--out {out}: expected a file ." in capsys.readouterr().err


def test_heights_beyond_the_map_are_bad_input(run_folder, tmp_path, capsys):
    arguments = ["--out", str(tmp_path / "esdf.npz"), "--from-height-m", "50"]
    assert main(["esdf", str(run_folder), *arguments]) == 2
    assert (
        "heights 50 to inf m: no voxel of 0.05 m has its middle between" in capsys.readouterr().err
    )


@pytest.mark.parametrize("command", ["grid", "esdf"])
def test_a_map_that_is_too_large_for_its_voxels_is_bad_input(run_folder, tmp_path, capsys, command):
    small = load_checkpoint(run_folder / "map.safetensors")
    poses = small.T_world_keyframe.copy()
    poses[-1, :3, 3] += 1000.0
    save_checkpoint(tmp_path / "large.safetensors", replace(small, T_world_keyframe=poses))
    up = ["--up", *(f"{part:.6f}" for part in _true_up())]
    assert main([command, str(tmp_path / "large.safetensors"), *up]) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: --voxel 0.05: a grid of ") and told.count("\n") == 1
