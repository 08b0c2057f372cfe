"""`hsslam-eval` as a user runs it."""

import json
from pathlib import Path

import pytest

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import Trajectory, read_tum, write_tum
from hsslam_node.services.evaluate import main
from hsslam_node.sources.source import SourceOptions, SynthOptions

_ROOM = SourceOptions(frames=60, synth=SynthOptions(width_px=96, height_px=72))
_SOURCE = (
    *("--source", "synth:room", "--frames", "60"),
    *("--synth.width-px", "96", "--synth.height-px", "72", "--depth-views", "6"),
    *("--cull-views", "6"),
)


@pytest.fixture(scope="module")
def result(tmp_path_factory) -> Path:
    """A trajectory that is 1 cm off along x in every second frame, and the true mesh, in its world."""
    folder = tmp_path_factory.mktemp("result")
    truth = open_ground_truth("synth:room", _ROOM)
    assert truth is not None
    T_world_truth = inverse(truth.T_world_cam[0])
    poses = T_world_truth @ truth.T_world_cam
    mesh = truth.mesh()
    assert mesh is not None
    mesh.apply_transform(T_world_truth)
    mesh.export(folder / "mesh.ply")
    poses[::2, 0, 3] += 0.01
    write_tum(folder / "trajectory.txt", Trajectory(truth.stamps_ns, poses))
    return folder


def test_table_json_and_pictures(result, tmp_path, capsys):
    files = ("--trajectory", str(result / "trajectory.txt"), "--mesh", str(result / "mesh.ply"))
    out = ("--json", str(tmp_path / "a" / "score.json"), "--plots", str(tmp_path / "plots"))
    main([*files, *_SOURCE, *out])
    shown = capsys.readouterr().out
    assert "RPE 1 s" in shown
    assert "0.50" in shown
    figures = json.loads((tmp_path / "a" / "score.json").read_text())
    assert figures["ate"]["final"]["rmse_m"] == pytest.approx(0.005, abs=2e-4)
    assert figures["ate"]["final"]["scored"] == 60
    assert figures["mesh"]["accuracy_mean_m"] < 0.008  # moved by half a centimetre
    assert 0 < figures["depth_l1"]["views"] <= 6  # sixty frames see little that turns inside it
    assert figures["consistency"]["given"][0]["gap_frames"] == 10
    assert figures["protocol"]["alignment"].startswith("SE(3)")
    names = {path.name for path in (tmp_path / "plots").iterdir()}
    assert names == {"trajectory.png", "error.png", "mesh.png", "virtual_views.txt"}
    views = read_tum(tmp_path / "plots" / "virtual_views.txt")
    assert len(views) == figures["depth_l1"]["views"]


@pytest.mark.parametrize(
    ("args", "expected"),
    [
        ([], "nothing to score"),
        (["--mesh", "there.ply"], "--source"),
        (["/there"], "run.json"),
        (["--mesh", "/there.ply", *_SOURCE], "there.ply"),
        (["--trajectory", "/there.txt", *_SOURCE], "there.txt"),
        (["--mesh", "m.ply", *_SOURCE, "--against", "tsdf"], "--trajectory"),
        (["--mesh", "m.ply", *_SOURCE, "--depth-view", "x"], "depth-view"),
        (["--trajectory", "TRAJECTORY", "--source", "synth:rom"], "synth:room"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(args, expected, result, capsys):
    args = [str(result / "trajectory.txt") if a == "TRAJECTORY" else a for a in args]
    with pytest.raises(SystemExit) as end:
        main(args)
    assert end.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert expected in lines[0]


def test_help_tells_the_units(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    shown = capsys.readouterr().out
    for unit in ("cm", "mm", "degrees", "dB"):
        assert unit in shown


def test_a_json_file_that_cannot_be_written(result, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    target = str(tmp_path / "file" / "score.json")
    with pytest.raises(SystemExit) as end:
        main(["--trajectory", str(result / "trajectory.txt"), *_SOURCE, "--json", target])
    assert end.value.code == 2
    assert "--json" in capsys.readouterr().err
