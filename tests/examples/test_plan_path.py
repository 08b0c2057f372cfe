"""The example that plans a path: as a user runs it, and whether the robot touches the true room."""

import importlib.util
import re
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.distance.grid_map import CELL_FREE, CELL_OCCUPIED, CELL_UNKNOWN, GridMap
from hsslam_node.distance.nav2_files import write_nav2_files
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_metrics import distances
from hsslam_node.map.checkpoint import save_checkpoint
from tests.in_process import run_script
from tests.repository import ROOT
from tests.small_room import OPTIONS, SMALL, mapped_room

EXAMPLE = ROOT / "examples/plan_path.py"
_SLACK_M = 0.05  # a voxel


@pytest.fixture(scope="module")
def map_file(tmp_path_factory) -> Path:
    room = mapped_room()
    path = tmp_path_factory.mktemp("map") / "room.safetensors"
    save_checkpoint(path, map_snapshot(room.store, room.parameters, SMALL))
    return path


def test_the_robot_touches_nothing_of_the_true_room(map_file):
    spec = importlib.util.spec_from_file_location("plan_path", EXAMPLE)
    assert spec and spec.loader
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    points, clearance_m = example.clearance(SavedMap.open(map_file, "cpu"), -0.1, 0.1)
    path = example.plan(clearance_m)
    way = points[tuple(path.T)]
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() < 1.5 * example.CELL_M
    assert np.linalg.norm(way[-1] - way[0]) > 0.4
    truth = open_ground_truth("synth:room", OPTIONS)
    mesh = truth.mesh() if truth else None
    assert truth is not None and mesh is not None
    T = truth.T_world_cam[0]
    true_m = distances(way @ T[:3, :3].T + T[:3, 3], mesh.vertices, mesh.faces)
    assert true_m.min() > example.RADIUS_M - _SLACK_M


def test_it_draws_the_path(map_file, tmp_path):
    picture = tmp_path / "path.png"
    done = run_script(EXAMPLE, str(map_file), str(picture))
    assert done.returncode == 0, done.stderr
    assert "m of room at the narrowest place" in done.stdout
    image = cv2.imread(str(picture))
    assert image is not None
    blue, green, red = (image[..., k].astype(int) for k in range(3))
    assert ((blue > 200) & (red < 60) & (green < 160)).sum() > 50


def test_it_plans_on_a_grid_for_nav2(tmp_path):
    """A floor of 4 x 3 m in unknown space, with a wall across it that has a door 1 m wide."""
    cells = np.full((80, 100), CELL_UNKNOWN, np.int8)
    cells[10:70, 10:90] = CELL_FREE
    cells[10:70, 60] = CELL_OCCUPIED
    cells[50:70, 60] = CELL_FREE
    grid = GridMap(cells, 0.05, (-1.0, 2.0), np.eye(4))
    write_nav2_files(tmp_path / "map.yaml", grid)
    done = run_script(EXAMPLE, str(tmp_path / "map.yaml"), str(tmp_path / "path.png"))
    assert done.returncode == 0, done.stderr
    numbers = [float(number) for number in re.findall(r"-?\d+\.\d*", done.stdout)]
    (x, y, _), (to_x, to_y, _) = numbers[:3], numbers[3:6]
    assert x < 2.0 < to_x  # the wall is at x = 2.0 to 2.05 m
    assert 2.5 < y < 5.5 and 2.5 < to_y < 5.5
    assert numbers[-1] >= 0.2
    image = cv2.imread(str(tmp_path / "path.png"))
    assert image is not None and image.shape[1] > image.shape[0]


def test_a_grid_without_its_picture_is_one_line(tmp_path):
    file = tmp_path / "map.yaml"
    for text, told in (
        ("image: none.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n", "none.pgm"),
        ("a", "grid"),
    ):
        file.write_text(text)
        done = run_script(EXAMPLE, str(file))
        assert done.returncode == 1
        assert told in done.stderr and done.stderr.count("\n") == 1


def test_only_a_grid_needs_pyyaml(monkeypatch):
    monkeypatch.setitem(sys.modules, "yaml", None)  # as if it were not installed
    done = run_script(EXAMPLE, "map.yaml")
    assert "error: map.yaml: package PyYAML is not installed: pip install pyyaml" in done.stderr
    assert "error: nowhere: no such file" in run_script(EXAMPLE, "nowhere").stderr


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((), "plan_path.py"),
        (("nowhere",), "error: nowhere: no such file"),
        (("a", "b", "c"), "FROM"),
        (("a", "b", "low", "0.1"), "error: low: expected a height in metres"),
        (("a", "b", "0.1", "nan"), "error: nan: expected a height in metres"),
        (("a", "b", "0.1", "-0.6"), "error: FROM_M 0.1 TO_M -0.6: expected from < to"),
    ],
)
def test_bad_input_is_one_line(arguments, text):
    done = run_script(EXAMPLE, *arguments)
    assert done.returncode == 1
    assert text in done.stderr and "Traceback" not in done.stderr


def test_a_height_without_room_is_told(map_file, tmp_path):
    done = run_script(EXAMPLE, str(map_file), str(tmp_path / "path.png"), "5", "6")
    assert done.returncode == 1
    assert "is the most room: expected 0.2 m" in done.stderr and done.stderr.count("\n") == 1


def test_a_picture_of_no_known_format_is_told(map_file, tmp_path):
    done = run_script(EXAMPLE, str(map_file), str(tmp_path / "path.xyz"))
    assert done.returncode == 1
    assert "path.xyz: cannot be written: expected a .png" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
