"""The picture that a finished run leaves."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import Trajectory, write_tum
from hsslam_services.commands.maps import picture
from hsslam_services.commands.maps.picture import draw_run

FLOOR, CEILING, WALL, BEHIND = (200, 30, 30), (30, 30, 200), (30, 200, 30), (200, 200, 30)  # RGB


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """A box of 4 x 2.4 x 4 m seen from inside, y down; the camera walks through it and looks along z."""
    room = trimesh.creation.box((4.0, 2.4, 4.0))
    room.invert()
    ends = {(1, 1): FLOOR, (1, -1): CEILING, (2, -1): BEHIND}  # by axis and side
    centre = room.triangles_center
    axis = (np.abs(centre) / room.extents).argmax(axis=1)
    side = np.sign(centre[np.arange(len(axis)), axis]).astype(int)
    colors = [ends.get(end, WALL) for end in zip(axis.tolist(), side.tolist(), strict=True)]
    corners = 0.99 * room.triangles + 0.01 * centre[:, None]  # no two walls share one
    mesh = trimesh.Trimesh(
        corners.reshape(-1, 3),
        np.arange(3 * len(axis)).reshape(-1, 3),
        process=False,
        vertex_colors=np.repeat(np.array(colors, np.uint8), 3, axis=0),
    )
    mesh.export(tmp_path / "mesh.ply")
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, 2, 3] = np.linspace(-1.5, 0.5, 20)
    write_tum(tmp_path / "trajectory.txt", Trajectory(np.arange(20), poses))
    return tmp_path


def _share(image: np.ndarray, rgb: tuple[int, int, int]) -> float:
    """Of the pixels of an image, BGR, that have about this hue: its bright channels are above 90."""
    return float(((image[..., ::-1] > 90) == (np.array(rgb) > 90)).all(axis=2).mean())


def test_it_shows_the_room_from_behind_the_camera_without_ceiling_and_near_wall(run_dir: Path):
    image = cv2.imread(str(draw_run(run_dir)))
    assert image is not None
    from_above, at_an_angle = np.split(image, 2, axis=1)
    for panel in (from_above, at_an_angle):
        assert _share(panel, FLOOR) > 0.1
        assert _share(panel, WALL) > 0.1
        assert _share(panel, CEILING) == 0
    assert _share(at_an_angle, BEHIND) < 1e-4


def test_a_run_that_saw_nothing_but_the_ceiling_has_a_picture_of_it(run_dir: Path):
    mesh = trimesh.load_mesh(run_dir / "mesh.ply", process=False)
    mesh.update_faces(mesh.face_normals[:, 1] > 0.9)  # towards the floor
    mesh.export(run_dir / "mesh.ply")
    image = cv2.imread(str(draw_run(run_dir)))
    assert image is not None
    assert _share(image, CEILING) > 0.1


def test_a_run_without_a_mesh_is_refused(tmp_path: Path):
    with pytest.raises(UserError, match=r"mesh\.ply: does not exist: expected a finished run"):
        draw_run(tmp_path)


@pytest.mark.parametrize(
    ("name", "data", "problem"),
    [
        ("mesh.ply", b"", "mesh.ply: damaged mesh: "),
        ("mesh.ply", b"junk" * 100, "mesh.ply: damaged mesh: "),
        ("mesh.ply", b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n", "mesh.ply: "),
        ("trajectory.txt", b"", "trajectory.txt: no poses"),
    ],
)
def test_a_run_with_a_damaged_file_is_one_line_and_code_2(
    run_dir: Path, name, data, problem, monkeypatch, capsys
):
    (run_dir / name).write_bytes(data)
    monkeypatch.setattr(sys, "argv", ["picture", str(run_dir)])
    with pytest.raises(SystemExit) as end:
        picture.main()
    error = capsys.readouterr().err
    assert end.value.code == 2 and problem in error and error.count("\n") == 1


def test_a_mesh_that_is_cut_off_is_refused(run_dir: Path):
    whole = (run_dir / "mesh.ply").read_bytes()
    (run_dir / "mesh.ply").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UserError, match=r"mesh\.ply: damaged mesh: "):
        draw_run(run_dir)


def test_a_picture_that_cannot_be_written_is_refused(run_dir: Path, monkeypatch):
    monkeypatch.setattr(picture, "_POINTS", 10_000)
    (run_dir / "picture.png").mkdir()
    with pytest.raises(UserError, match=r"picture\.png: .*: expected a file that can be written"):
        draw_run(run_dir)
