"""`hsslam-map export --texture` on a map of the small room: read by trimesh, drawn, compared with a frame."""

import errno
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hsslam_node.evaluation.image_quality import psnr_db
from hsslam_node.evaluation.mesh.mesh_view import MeshView
from hsslam_node.export.opengl_axes import OPENGL_FROM_OPENCV
from hsslam_node.geometry.triangles import triangle_mesh
from hsslam_services.commands.maps.command import main
from tests.small_room import room_frames, room_poses

_COARSE = ("--voxel", "0.04", "--device", "cpu", "--texture-px", "1024")
_HELD_OUT = (10, 22, 34)  # frames that are no keyframes


def _drawn_db(mesh: trimesh.Trimesh) -> float:
    """PSNR of what the mesh covers of frames that it was not made of."""
    view, found = MeshView(mesh), []
    for k in _HELD_OUT:
        frame = room_frames()[k]
        image, depth_m = view.draw(frame.camera, room_poses()[k])
        hit = depth_m > 0
        assert hit.mean() > 0.8
        found.append(psnr_db(image[hit], frame.color[hit] / 255.0))
    return float(np.mean(found))


@pytest.mark.parametrize("kind", ["glb", "obj"])
def test_a_texture_draws_other_frames_better_than_colours_of_vertices(
    mapped_run, tmp_path, capsys, kind
):
    found = {}
    for name, more in (("plain", ()), ("my room", ("--texture",))):
        out = tmp_path / f"{name}.{kind}"
        arguments = ["export", str(mapped_run), "--format", kind, "-o", str(out), *_COARSE, *more]
        assert main(arguments) == 0
        found[name] = triangle_mesh(out, "a mesh")
        if kind == "glb":
            found[name].apply_transform(OPENGL_FROM_OPENCV)
    told = capsys.readouterr().out.splitlines()[-1]
    assert told.startswith(f"{out}: {len(found['my room'].faces)} triangles, texture of ")
    assert _drawn_db(found["my room"]) > _drawn_db(found["plain"]) + 2.5
    if kind == "obj":
        files = sorted(path.name for path in tmp_path.iterdir())
        assert files == ["my room.obj", "my_room.mtl", "my_room.png", "plain.obj"]
        words = [line.split() for line in (tmp_path / "my_room.mtl").read_text().splitlines()]
        assert ["map_Kd", "my_room.png"] in words  # no blank in a name: readers split there
        assert {"mtllib my_room.mtl", "usemtl my_room"} < set(out.read_text().splitlines())
        (diffuse,) = [line[1:] for line in words if line[:1] == ["Kd"]]
        assert [float(value) for value in diffuse] == [1, 1, 1]  # a factor of the image


def test_a_textured_obj_that_does_not_fit_leaves_all_older_files(
    mapped_run, tmp_path, capsys, monkeypatch
):
    """The text of the mesh is the largest of the three files."""
    older = [tmp_path / f"room.{kind}" for kind in ("mtl", "obj", "png")]
    for path in older:
        path.write_bytes(b"older")
    write = Path.write_bytes

    def fill_up(path: Path, data: bytes) -> int:
        if b"mtllib" in data:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", fill_up)
    out = str(tmp_path / "room.obj")
    arguments = ["--format", "obj", "--texture", "-o", out, *_COARSE]
    assert main(["export", str(mapped_run), *arguments]) == 2
    assert f"--out {out}: No space left on device" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == older
    assert [path.read_bytes() for path in older] == 3 * [b"older"]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--format", "ply", "--texture"), "--texture: --format ply: expected glb or obj"),
        (("--format", "glb", "--texture-px", "9"), "--texture-px 9: expected 256 to 16384"),
    ],
)
def test_bad_input_is_one_line_and_code_2(
    mapped_run, tmp_path, monkeypatch, capsys, arguments, text
):
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(mapped_run), *arguments]) == 2
    assert capsys.readouterr().err == f"error: {text}\n"
    assert not list(tmp_path.iterdir())
