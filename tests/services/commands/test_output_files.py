"""Files that options of commands name, and those without a name."""

import json
import os
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_services.commands.ctl import main as ctl
from hsslam_services.commands.maps.command import main as maps
from hsslam_services.commands.maps.mesh import main as mesh
from hsslam_services.commands.output_files import expect_json_file, write_json_file


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


def test_a_dash_is_no_file_for_json():
    with pytest.raises(UserError, match=r"^--json -: expected a file, or /dev/stdout$"):
        expect_json_file(Path("-"))


def test_a_path_that_is_not_utf8_is_text_in_json(tmp_path):
    name = os.fsdecode(b"desk\xff")
    write_json_file(tmp_path / name, {"source": name, "of": [{name: (1, 2.5, None, "\u00e9")}]})
    found = json.loads((tmp_path / name).read_text("utf-8"))
    assert found == {"source": "desk\ufffd", "of": [{"desk\ufffd": [1, 2.5, None, "\u00e9"]}]}
