"""Files that options of commands name, and those without a name."""

import json
import os
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_services.commands.ctl import main as ctl
from hsslam_services.commands.maps.command import main as maps
from hsslam_services.commands.maps.mesh import main as mesh
from hsslam_services.commands.maps.render import RenderOptions
from hsslam_services.commands.maps.render import main as render
from hsslam_services.commands.output_files import (
    expect_file,
    expect_json_file,
    print_written,
    write_json_file,
)


@pytest.mark.parametrize("mark", ["run.json", "map.safetensors"])
@pytest.mark.parametrize(
    ("command", "words"), [(mesh, ["."]), (maps, ["export", "."]), (ctl, ["mesh"])]
)
def test_without_a_name_the_mesh_of_a_run_stays(
    tmp_path, monkeypatch, capsys, command, words, mark
):
    monkeypatch.chdir(tmp_path)
    for name in (mark, "mesh.ply"):
        (tmp_path / name).write_text("of the run")
    try:
        code = command(words)
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    told = f"error: {tmp_path}: is a run folder, whose mesh.ply stays: expected --out FILE\n"
    assert capsys.readouterr().err == told
    assert (tmp_path / "mesh.ply").read_text() == "of the run"


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (mesh, ["m", "--out", "/proc/x.ply"]),
        (ctl, ["mesh", "--out", "/proc/x.ply"]),
        (maps, ["export", "m", "--out", "/proc/x.glb"]),
        (maps, ["grid", "m", "--out", "/proc/x.yaml"]),
        (maps, ["esdf", "m", "--out", "/proc/x.npz"]),
        (render, ["m", "--trajectory", "t", "--video", "/proc/x.avi"]),
    ],
)
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(capsys, command, words):
    try:
        code = command(words)
    except SystemExit as ended:
        code = ended.code
    told = capsys.readouterr().err
    assert (
        code == 2 and told.startswith(f"error: {words[-2]} {words[-1]}: ") and told.count("\n") == 1
    )
    assert told.endswith(": expected a file that can be written\n")


def test_a_file_of_an_option_has_its_suffix_and_is_no_folder(tmp_path):
    (tmp_path / "a.ply").mkdir()
    for name in ("a.ply", "b.txt", "no/c.ply"):
        with pytest.raises(
            UserError, match=r"expected a file \.glb or \.ply in a folder that exists$"
        ):
            expect_file("--out", tmp_path / name, (".glb", ".ply"))
    expect_file("--out", tmp_path / "B.PLY", (".glb", ".ply"))
    expect_file("--out", Path("/dev/stdout"))
    (tmp_path / "link.ply").symlink_to("/proc/x.ply")
    with pytest.raises(UserError, match=r"link\.ply: .*: expected a file that can be written$"):
        expect_file("--out", tmp_path / "link.ply")


def test_opencv_is_given_no_path_that_it_cannot_write(tmp_path):
    video = tmp_path / os.fsdecode(b"desk\xff.avi")
    with pytest.raises(UserError, match=r"OpenCV writes to paths in UTF-8 alone$"):
        RenderOptions(video=video)


def test_what_was_written_to_stdout_is_told_on_stderr(tmp_path, capfd):
    (tmp_path / "t.txt").touch()
    for path in (tmp_path / "t.txt", Path("/dev/stdout")):
        print_written(path, "3 poses")
    told = capfd.readouterr()
    assert told.out == f"{tmp_path}/t.txt: 3 poses\n"
    assert told.err == "/dev/stdout: 3 poses\n"


def test_a_dash_is_no_file_for_json():
    with pytest.raises(UserError, match=r"^--json -: expected a file, or /dev/stdout$"):
        expect_json_file(Path("-"))


def test_a_path_that_is_not_utf8_is_text_in_json(tmp_path):
    name = os.fsdecode(b"desk\xff")
    write_json_file(tmp_path / name, {"source": name, "of": [{name: (1, 2.5, None, "\u00e9")}]})
    found = json.loads((tmp_path / name).read_text("utf-8"))
    assert found == {"source": "desk\ufffd", "of": [{"desk\ufffd": [1, 2.5, None, "\u00e9"]}]}
