"""`hsslam-eval` as a user runs it."""

import json
import subprocess
import sys
from io import StringIO
from pathlib import Path

import msgspec
import pytest
import trimesh
from rich.console import Console

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import Trajectory, read_tum, write_tum
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto import messages, topics
from hsslam_proto.codec import encode
from hsslam_proto.pose_codec import wire_pose
from hsslam_services.commands.evaluate.command import _views_file, _writable_folder, main
from hsslam_services.commands.evaluate.table import eval_table
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.run.options import ServeOptions
from tests.few_samples import few_samples  # noqa: F401
from tests.services.wire_samples import pose

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


@pytest.mark.usefixtures("few_samples")
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
    assert "│ exact" in shown and "│ lit." in shown
    assert 0.001 < figures["mesh_literature"]["accuracy_mean_m"] < 0.02  # points are that far apart
    assert 0 < figures["depth_l1"]["views"] <= 6  # sixty frames see little that turns inside it
    assert figures["consistency"]["given"][0]["gap_frames"] == 10
    assert figures["protocol"]["alignment"].startswith("SE(3)")
    names = {path.name for path in (tmp_path / "plots").iterdir()}
    assert names == {"trajectory.png", "error.png", "mesh.png", "virtual_views.txt"}
    views = read_tum(tmp_path / "plots" / "virtual_views.txt")
    assert len(views) == figures["depth_l1"]["views"]


def test_stamps_of_six_decimals_find_the_frames_for_consistency_too(result, tmp_path, capsys):
    poses, path = read_tum(result / "trajectory.txt"), tmp_path / "six.txt"
    write_tum(path, Trajectory(poses.stamps_ns // 1000 * 1000, poses.T_world_cam))
    main(["--trajectory", str(path), *_SOURCE, "--json", str(tmp_path / "score.json")])
    found = json.loads((tmp_path / "score.json").read_text())["consistency"]["estimated"][0]
    assert found["pairs"] == found["possible"] == 5
    assert capsys.readouterr().out.count(" 5/5 ") == 2  # estimated, given


def test_a_mesh_that_too_few_poses_align_is_not_scored(result, tmp_path, capsys):
    poses, two = read_tum(result / "trajectory.txt"), tmp_path / "two.txt"
    write_tum(two, Trajectory(poses.stamps_ns[:2], poses.T_world_cam[:2]))
    files = ("--trajectory", str(two), "--mesh", str(result / "mesh.ply"))
    main([*files, *_SOURCE, "--no-consistency", "--json", str(tmp_path / "score.json")])
    captured = capsys.readouterr()
    text = "2 of 2 poses have a true one: expected 3 or more to align the mesh by"
    assert captured.err == f"mesh: not scored: {text}\n" and "2/60" in captured.out
    figures = json.loads((tmp_path / "score.json").read_text())
    assert figures["left_out"] == {"mesh": text} and "mesh" not in figures


def test_a_place_that_cannot_be_written_is_refused_before_anything_is_measured(tmp_path, capsys):
    (tmp_path / "file").touch()
    for option, name in (("--json", "file/score.json"), ("--plots", "file/plots")):
        with pytest.raises(SystemExit) as end:
            main(["--trajectory", "/no.txt", *_SOURCE, option, str(tmp_path / name)])
        told = capsys.readouterr().err
        assert end.value.code == 2 and told.count("\n") == 1
        assert told.startswith(f"error: {option} {tmp_path}/file")


def test_scores_go_to_a_pipe_and_not_into_a_folder(result, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    poses = ("--trajectory", str(result / "trajectory.txt"), *_SOURCE, "--no-consistency")
    main([*poses, "--json", "/dev/stdout"])
    told = capfd.readouterr().out
    start, end = told.index("\n{\n") + 1, told.rindex("\n}\n") + 3
    assert json.loads(told[start:end])["source"] == "synth:room"
    assert Path("/dev/stdout").is_symlink() and not Path("/dev/virtual_views.txt").exists()
    with pytest.raises(SystemExit) as left:
        main([*poses, "--json", str(tmp_path)])
    text = f"error: --json {tmp_path}: is a folder: expected a file to write\n"
    assert (left.value.code, capfd.readouterr().err) == (2, text)


def test_a_stream_has_no_file_of_views_beside_it(tmp_path):
    scores = tmp_path / "score.json"
    scores.touch()
    assert _views_file(None, scores) == tmp_path / "score.virtual_views.txt"
    program = """
from pathlib import Path
from hsslam_services.commands.evaluate.command import _views_file
assert Path("/dev/stdout").is_file() and _views_file(None, Path("/dev/stdout")) is None
"""
    with scores.open("w") as out:
        subprocess.run([sys.executable, "-c", program], stdout=out, check=True)


@pytest.mark.usefixtures("few_samples")
def test_a_mesh_that_no_camera_sees_is_told(result, tmp_path, capsys):
    """As one in mm."""
    mesh = trimesh.load(result / "mesh.ply", process=False, force="mesh")
    mesh.vertices = 1000 * mesh.vertices
    mesh.export(tmp_path / "mm.ply")
    files = ("--trajectory", str(result / "trajectory.txt"), "--mesh", str(tmp_path / "mm.ply"))
    few = ("--frames", "12", "--no-consistency", "--depth-views", "0", "--cull-views", "0")
    main([*files, *_SOURCE, *few])
    text = "no camera sees any of it: expected metres, in the world of the trajectory"
    assert capsys.readouterr().err == f"mesh: not scored: {text}\n"


def test_a_trajectory_of_other_frames_is_bad_input(result, tmp_path, capsys):
    poses, other = read_tum(result / "trajectory.txt"), tmp_path / "other.txt"
    write_tum(other, Trajectory(poses.stamps_ns + 10**12, poses.T_world_cam))
    empty = tmp_path / "empty.txt"
    empty.write_text("# none\n")
    for path, text in ((other, "none of its poses, 1000"), (empty, "no poses: expected poses")):
        with pytest.raises(SystemExit) as end:
            main(["--trajectory", str(path), "--mesh", str(result / "mesh.ply"), *_SOURCE])
        told = capsys.readouterr().err
        assert end.value.code == 2 and told.count("\n") == 1
        assert told.startswith(f"error: --trajectory {path}: {text}")


@pytest.mark.usefixtures("few_samples")
def test_tsdfs_of_both_settings_are_scored_by_both_protocols(result, tmp_path, capsys):
    pytest.importorskip("open3d", exc_type=ImportError)
    poses = ("--trajectory", str(result / "trajectory.txt"), *_SOURCE, "--against", "tsdf")
    few = ("--frames", "12", "--depth-views", "0", "--cull-views", "0", "--no-consistency")
    main([*poses, *few, "--json", str(tmp_path / "both.json")])
    assert capsys.readouterr().out.count("TSDF 3 / 12 cm") == 2  # exact, literature
    both = json.loads((tmp_path / "both.json").read_text())["tsdf"]
    assert list(both) == ["TSDF 2 / 6 cm", "TSDF 3 / 12 cm"]
    for found in both.values():
        assert found["mesh"]["accuracy_median_m"] < 0.02
        assert found["mesh_literature"]["samples"] > 0
    main([*poses, *few, "--tsdf.voxel-m", "0.05", "--json", str(tmp_path / "one.json")])
    one = json.loads((tmp_path / "one.json").read_text())["tsdf"]
    assert list(one) == ["TSDF 5 / 6 cm"]
    names = ["both.json", "both.virtual_views.txt", "one.json", "one.virtual_views.txt"]
    assert sorted(each.name for each in tmp_path.iterdir()) == names


def test_a_torn_log_is_scored_with_its_poses_as_refined(tmp_path, capsys):
    options = ServeOptions(source="synth:room", frames=60, synth=_ROOM.synth, evaluate=False)
    whole = _log(tmp_path, {"options": msgspec.json.encode(options).decode()}).read_bytes()
    torn = tmp_path / "run.mcap"
    torn.write_bytes(whole[:-40])
    main([f"mcap:{torn}", "--depth-views", "0", "--json", str(tmp_path / "score.json")])
    captured = capsys.readouterr()
    assert "was not finished: recovered 63 messages" in captured.err
    ate = json.loads((tmp_path / "score.json").read_text())["ate"]
    assert ate["final"]["scored"] == ate["final"]["expected"] == 60
    assert ate["final"]["rmse_m"] < 1e-6 < 0.01 < ate["online"]["rmse_m"]
    (tmp_path / "run.json").write_text("of a run that was killed")
    main([str(tmp_path), "--depth-views", "0", "--no-consistency"])
    assert "no trajectory.txt" in capsys.readouterr().err


def test_a_run_folder_that_cannot_be_written_costs_only_the_plots(tmp_path, capsys):
    (tmp_path / "evaluation").write_text("no folder")
    assert _writable_folder(str(tmp_path)) is None
    told = capsys.readouterr().err
    assert told.startswith(f"no plots: {tmp_path}/evaluation: File exists: expected a folder")
    assert told.endswith(", or --plots FOLDER\n")


def test_the_field_alone_and_views_are_two_lines_of_one_table():
    field = {"psnr_db": 27.37, "ssim": 0.808, "pixels_ratio": 1.0, "images": 31}
    console = Console(width=100, record=True, file=StringIO())
    for table in eval_table({"rendering": field, "views": {**field, "psnr_db": 31.84}}):
        console.print(table)
    lines = [line.split() for line in console.export_text().splitlines() if "│" in line]
    assert [line[1:-1] for line in lines] == [
        ["field", "alone", "│", "27.37", "│", "0.808", "│", "100.0", "│", "31"],
        ["hsslam-render", "│", "31.84", "│", "0.808", "│", "100.0", "│", "31"],
    ]
    assert len(eval_table({"rendering": field})) == 1 and not eval_table({})


def test_a_log_that_does_not_tell_its_source_is_told_of_it(tmp_path, capsys):
    path = str(_log(tmp_path, {}))
    with pytest.raises(SystemExit) as end:
        main([path])
    assert end.value.code == 2
    assert "expected --source" in capsys.readouterr().err
    main([path, *_SOURCE, "--no-consistency"])
    assert "60/60" in capsys.readouterr().out


def _log(folder: Path, metadata: dict[str, str]) -> Path:
    """True poses, from frame 30 on 4 cm off until a correction at the end."""
    truth = open_ground_truth("synth:room", _ROOM)
    assert truth is not None
    log = PartedLog(folder, "r", LogSettings(metadata=metadata))

    def put(topic, message, at_ns):
        log.write(topic, encode(topic, message), at_ns, at_ns, at_ns)

    moved = truth.T_world_cam.copy()
    moved[30:, 0, 3] += 0.04
    for index, (stamp, T) in enumerate(zip(truth.stamps_ns.tolist(), moved, strict=True)):
        t, q = wire_pose(T)
        at = pose(index)
        fields = {name: getattr(at, name) for name in at.__struct_fields__}
        fields |= {"source_stamp_ns": stamp, "t": t, "q": q, "keyframe": index // 30}
        put(topics.POSE, messages.Pose(**fields), index)
        if index % 30 == 0:  # after the pose, as the tracker does
            key = messages.Keyframe(
                id=index // 30, frame_index=index, source_stamp_ns=stamp, t=t, q=q
            )
            put(topics.KEYFRAME, key, index)
    t, q = wire_pose(truth.T_world_cam[30])
    corrected = messages.Correction(
        pose_version=1, base_version=0, keyframes=[1], t=[t], q=[q], loss_before=2.0, loss_after=1.0
    )
    put(topics.CORRECTION, corrected, 60)
    log.close()
    return folder / "run.mcap"


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
        (["--mesh", "m.ply", *_SOURCE, "--tsdf.voxel-m", "0.01"], "expected with --against tsdf"),
        (["--views", "--no-rendering"], "--views: expected without --no-rendering"),
        (
            ["--trajectory", "t.txt", *_SOURCE, "--views"],
            "--views: draws a saved map: expected with a RUN",
        ),
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
