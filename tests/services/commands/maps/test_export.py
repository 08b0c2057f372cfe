"""`hsslam-map export` on a map of the small room: mesh and points, read by others' readers."""

import contextlib

import numpy as np
import pytest
import trimesh

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.geometry.triangles import triangle_mesh
from hsslam_services.commands.maps.command import main

_COARSE = ("--voxel", "0.08", "--device", "cpu")


@pytest.fixture(scope="module")
def mesh(mapped_run) -> trimesh.Trimesh:
    return SavedMap.open(mapped_run / "map.safetensors", "cpu").mesh(0.08)


def _colors(mesh) -> np.ndarray:
    return np.asarray(mesh.visual.vertex_colors)[:, :3]


@pytest.mark.parametrize("kind", ["ply", "glb", "obj"])
def test_a_mesh_keeps_vertices_triangles_and_colours(mapped_run, mesh, tmp_path, capsys, kind):
    out = tmp_path / f"room.{kind}"
    assert main(["export", str(mapped_run), "--format", kind, "-o", str(out), *_COARSE]) == 0
    found = triangle_mesh(out, "a mesh")
    told = f"{out}: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles\n"
    assert capsys.readouterr().out == told
    expected = np.array(mesh.vertices)
    if kind == "glb":
        expected[:, 1:] *= -1  # y up, z back
    np.testing.assert_allclose(found.vertices, expected, atol=1e-6)
    np.testing.assert_array_equal(found.faces, mesh.faces)
    np.testing.assert_allclose(_colors(found).astype(int), _colors(mesh), atol=1)
    assert _colors(mesh).std() > 10


def test_without_a_format_the_file_ends_in_it(mapped_run, mesh, tmp_path, capsys):
    assert main(["export", str(mapped_run), "-o", str(tmp_path / "room.PCD"), *_COARSE]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'room.PCD'}: {len(mesh.vertices)} points\n"


def test_the_library_of_usd_reads_the_mesh_with_y_up(mapped_run, mesh, tmp_path, capsys):
    from pxr import Usd, UsdGeom

    out = tmp_path / "room.usd"
    assert main(["export", str(mapped_run), "--format", "usd", "-o", str(out), *_COARSE]) == 0
    told = f"{out}: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles\n"
    assert capsys.readouterr().out == told
    stage = Usd.Stage.Open(str(out))
    found = UsdGeom.Mesh(stage.GetPrimAtPath("/hsslam/mesh"))
    expected = np.array(mesh.vertices) * [1, -1, -1]
    np.testing.assert_allclose(np.array(found.GetPointsAttr().Get()), expected, atol=1e-6)
    assert np.array(found.GetDisplayColorPrimvar().Get()).std() > 0.04


def test_open3d_reads_the_points_with_their_colours(mapped_run, mesh, tmp_path, monkeypatch):
    open3d = pytest.importorskip("open3d", exc_type=(ImportError, OSError))
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(mapped_run), "--format", "pcd", *_COARSE]) == 0
    cloud = open3d.io.read_point_cloud("points.pcd")
    np.testing.assert_allclose(np.asarray(cloud.points), mesh.vertices, atol=1e-6)
    np.testing.assert_allclose(255 * np.asarray(cloud.colors), _colors(mesh), atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((), "export: no map: expected a run folder or map.safetensors"),
        (("FOLDER",), "FOLDER/map.safetensors: no such file: expected a map"),
        (("MAP", "--format", "plx"), "--format plx: expected ply or glb"),
        (("MAP", "--format", "opj"), "did you mean obj?"),
        (("MAP", "--voxel", "0"), "--voxel 0.0: expected 0.001 to 1 m"),
        (("MAP", "--format", "ply", "--out", "x.glb"), "--out x.glb: expected a file .ply in a f"),
        (
            ("MAP", "--out", "x.stl"),
            "--out x.stl: expected a file .ply, .glb, .obj, .usd, .pcd, or --",
        ),
        (
            ("MAP", "--voxel", "1"),
            "keyframes see no surface with --voxel 1: expected smaller voxels",
        ),
        (("MAP", "--texture", "--out", "x.pcd"), "--texture: --format pcd: expected glb or obj"),
        (("MAP", "--out", "/nowhere/x.ply"), "--out /nowhere/x.ply: expected a file .ply"),
        (("MAP", *_COARSE, "--format", "usd", "--out", "/proc/x.usd"), "--out /proc/x.usd: "),
        (("MAP", *_COARSE, "--out", "/proc/x.ply"), "--out /proc/x.ply: No such file or directory"),
    ],
)
def test_bad_input_is_one_line_and_code_2(mapped_run, tmp_path, arguments, text, capsys):
    places = {"MAP": str(mapped_run), "FOLDER": str(tmp_path)}
    assert main(["export", *(places.get(word, word) for word in arguments)]) == 2
    told = capsys.readouterr().err
    assert text.replace("FOLDER", str(tmp_path)) in told
    assert told.startswith("error: ") and told.count("\n") == 1


def test_a_full_disk_is_one_line_and_leaves_the_older_file(mapped_run, disk, capsys):
    folder, ballast = disk.folder / "maps", disk.folder / "ballast"
    folder.mkdir()
    out = folder / "room.pcd"
    out.write_bytes(b"older")
    with contextlib.suppress(OSError), ballast.open("wb", buffering=0) as stream:
        while stream.write(bytes(4096)):
            pass
    arguments = ["--format", "pcd", "--out", str(out), *_COARSE]
    assert main(["export", str(mapped_run), *arguments]) == 2
    told = capsys.readouterr().err
    assert told == (
        f"error: --out {out}: No space left on device: expected a file that can be written\n"
    )
    assert [file.name for file in folder.iterdir()] == ["room.pcd"]
    assert out.read_bytes() == b"older"
