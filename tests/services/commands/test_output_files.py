"""Where commands write without `--out`."""

import pytest

from hsslam_services.commands.ctl import main as ctl
from hsslam_services.commands.maps.command import main as maps
from hsslam_services.commands.maps.mesh import main as mesh


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
