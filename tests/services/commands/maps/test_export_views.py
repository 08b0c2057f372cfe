"""`hsslam-map export` for tools that train views: what they read fits images and depth of the true room."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from hsslam_node.evaluation.image_quality import psnr_db
from hsslam_node.geometry.projection import project
from hsslam_node.geometry.se3 import transform
from hsslam_node.map.checkpoint import load_checkpoint, save_checkpoint
from hsslam_services.commands.maps.command import main
from tests.small_room import room_frames, room_poses

_COARSE = ("--voxel", "0.04", "--device", "cpu")
_LAST = 9  # keyframe: frame 36


def _exported(run: Path, kind: str, folder: Path) -> Path:
    out = folder / "room"
    assert main(["export", str(run), "--format", kind, "--out", str(out), *_COARSE]) == 0
    return out


@pytest.fixture(scope="module")
def nerfstudio(mapped_run, tmp_path_factory) -> Path:
    return _exported(mapped_run, "nerfstudio", tmp_path_factory.mktemp("views"))


def _differences_m(points: np.ndarray, K: np.ndarray, T_cam_world: np.ndarray) -> np.ndarray:
    """How much farther points [N, 3] are than the true depth of the last keyframe, [m] m.

    Only of points that K, which counts pixel middles at 0.5, and T_cam_world [4, 4] put within 10 cm of it:
    others are hidden or out of view.
    """
    true_m = room_frames()[4 * _LAST].depth_m()
    x, y, z = T_cam_world[:3, :3] @ points.T + T_cam_world[:3, 3:]
    ahead = z > 0.1
    u, v, _ = K @ (np.stack([x, y, z])[:, ahead] / z[ahead])
    z, row, column = z[ahead], np.floor(v).astype(int), np.floor(u).astype(int)
    height, width = true_m.shape
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    difference_m = z[inside] - true_m[row[inside], column[inside]]
    return difference_m[np.abs(difference_m) < 0.1]


def _expect_fit(points: np.ndarray, K: np.ndarray, T_cam_world: np.ndarray) -> None:
    difference_m = _differences_m(points, K, T_cam_world)
    assert len(difference_m) > 0.3 * len(points)
    assert np.median(np.abs(difference_m)) < 0.02 and abs(np.median(difference_m)) < 0.01


def test_the_points_of_nerfstudio_project_to_the_true_depth(nerfstudio):
    told = json.loads((nerfstudio / "transforms.json").read_text())
    assert len(told["frames"]) == 10
    frame = told["frames"][_LAST]
    K = np.array([[frame["fl_x"], 0, frame["cx"]], [0, frame["fl_y"], frame["cy"]], [0, 0, 1]])
    camera = room_frames()[0].camera
    np.testing.assert_allclose(K[:2, 2], [camera.cx + 0.5, camera.cy + 0.5])
    T_world_opengl = np.array(frame["transform_matrix"])
    T_cam_world = np.linalg.inv(T_world_opengl @ np.diag([1, -1, -1, 1]))
    points = np.asarray(trimesh.load(nerfstudio / told["ply_file_path"]).vertices)
    _expect_fit(points, K, T_cam_world)
    turned = _differences_m(points, K, np.linalg.inv(T_world_opengl))  # in the axes of OpenCV
    assert len(turned) < 0.1 * len(points)


def test_images_and_depth_are_those_of_the_frame_of_the_pose(nerfstudio):
    frame = json.loads((nerfstudio / "transforms.json").read_text())["frames"][_LAST]
    true = room_frames()[4 * _LAST]
    np.testing.assert_allclose(
        np.array(frame["transform_matrix"])[:3, 3], room_poses()[4 * _LAST, :3, 3], atol=1e-9
    )
    color = cv2.cvtColor(cv2.imread(str(nerfstudio / frame["file_path"])), cv2.COLOR_BGR2RGB)
    assert color.shape[:2] == (frame["h"], frame["w"])
    assert psnr_db(color / 255.0, true.color / 255.0) > 30
    depth = cv2.imread(str(nerfstudio / frame["depth_file_path"]), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    np.testing.assert_allclose(depth / 1000.0, true.depth_m(), atol=0.0006)


def test_the_points_have_the_colours_of_the_images(nerfstudio):
    cloud = trimesh.load(nerfstudio / "points.ply")
    colors = np.asarray(cloud.visual.vertex_colors)[:, :3]
    images = [cv2.imread(str(path)) for path in sorted((nerfstudio / "images").iterdir())]
    mean_rgb = np.mean([image.mean(axis=(0, 1)) for image in images], axis=0)[::-1]
    np.testing.assert_allclose(colors.mean(axis=0), mean_rgb, atol=30)


@pytest.fixture(scope="module")
def colmap(mapped_run, tmp_path_factory) -> Path:
    return _exported(mapped_run, "colmap", tmp_path_factory.mktemp("scene"))


def _rows(path: Path) -> list[list[str]]:
    """The words of each line that is no remark; a line without words counts."""
    lines = path.read_text().split("\n")[:-1]
    return [line.split() for line in lines if not line.startswith("#")]


def test_the_points_of_colmap_project_to_the_true_depth(colmap):
    ((number, model, width, height, *intrinsics),) = _rows(colmap / "sparse/0/cameras.txt")
    assert (number, model, width, height) == ("1", "PINHOLE", "160", "120")
    fx, fy, cx, cy = map(float, intrinsics)
    images = _rows(colmap / "sparse/0/images.txt")
    assert len(images) == 2 * 10
    number, *pose, of_camera, name = images[2 * _LAST]
    assert (number, of_camera, name) == (str(_LAST + 1), "1", "000009.jpg")
    qw, qx, qy, qz, *t = map(float, pose)
    T_cam_world = transform(np.array(t), np.array([qx, qy, qz, qw]))
    points = np.array([row[1:4] for row in _rows(colmap / "sparse/0/points3D.txt")], float)
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    _expect_fit(points, K, T_cam_world)
    np.testing.assert_allclose(np.linalg.inv(T_cam_world), room_poses()[4 * _LAST], atol=1e-6)


def test_observations_of_colmap_lie_where_the_points_project_to(colmap):
    camera = room_frames()[0].camera
    points = _rows(colmap / "sparse/0/points3D.txt")
    observed = np.array(_rows(colmap / "sparse/0/images.txt")[2 * _LAST + 1], float).reshape(-1, 3)
    assert 200 < len(observed) <= 2000
    seen = [points[int(number) - 1] for number in observed[:, 2]]
    positions = np.array([row[1:4] for row in seen], float)
    u, v, z = project(positions, camera, np.linalg.inv(room_poses()[4 * _LAST]))
    np.testing.assert_allclose(observed[:, :2], np.stack([u, v], 1) + 0.5, atol=0.01)
    column, row = np.floor(observed[:, :2]).astype(int).T
    true_m = room_frames()[4 * _LAST].depth_m()[row, column]
    assert np.quantile(np.abs(z - true_m), 0.99) < 0.031  # a rounded pixel may be the next one
    for index, row in enumerate(seen):
        tracks = list(zip(row[8::2], row[9::2], strict=True))
        assert (str(_LAST + 1), str(index)) in tracks


def test_images_of_colmap_are_there_by_name(colmap, nerfstudio):
    names = [row[-1] for row in _rows(colmap / "sparse/0/images.txt")[::2]]
    assert names == sorted(path.name for path in (colmap / "images").iterdir())
    for name in names:
        of_both = [(folder / "images" / name).read_bytes() for folder in (colmap, nerfstudio)]
        assert of_both[0] == of_both[1]


def test_an_empty_folder_may_be_a_link(mapped_run, nerfstudio, tmp_path):
    (tmp_path / "disk").mkdir()
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "disk")
    arguments = ["--format", "nerfstudio", "--out", str(link), "--voxel", "0.1", "--device", "cpu"]
    assert main(["export", str(mapped_run), *arguments]) == 0
    names = sorted(path.name for path in nerfstudio.iterdir())
    assert sorted(path.name for path in (tmp_path / "disk").iterdir()) == names
    assert link.is_symlink()


def test_a_folder_that_holds_something_is_refused(mapped_run, nerfstudio, capsys):
    arguments = ["--format", "nerfstudio", "--out", str(nerfstudio)]
    assert main(["export", str(mapped_run), *arguments]) == 2
    told = capsys.readouterr().err
    assert told == f"error: --out {nerfstudio}: already exists: expected a new folder\n"
    assert sorted(path.name for path in nerfstudio.parent.iterdir()) == ["room"]


def test_a_map_without_images_is_one_line_and_leaves_nothing(mapped_run, tmp_path, capsys):
    old, out = tmp_path / "old.safetensors", tmp_path / "views"
    save_checkpoint(old, replace(load_checkpoint(mapped_run / "map.safetensors"), images=None))
    arguments = ["--format", "nerfstudio", "--out", str(out), "--voxel", "0.2", "--device", "cpu"]
    assert main(["export", str(old), *arguments]) == 2
    told = capsys.readouterr().err
    assert "saved without keyframe images" in told and told.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["old.safetensors"]
