"""`hsslam-bench peers` as a user runs it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_bench.peers.command import peers_command
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.trajectory import Trajectory, write_tum


def test_results_that_a_user_has_stand_in_one_table(tum_folder: Path, tmp_path: Path, capsys):
    truth = open_ground_truth(f"tum:{tum_folder}")
    assert truth is not None
    write_tum(tmp_path / "good.txt", truth.trajectory)
    lines = (tmp_path / "good.txt").read_text().splitlines()
    (tmp_path / "part.txt").write_text("\n".join(lines[:-1]) + "\n")
    out = tmp_path / "out" / "peers.json"
    results = (f"orb-slam3={tmp_path / 'good.txt'}", f"rtabmap={tmp_path / 'part.txt'}")
    source = ("--no-run", "--source", f"tum:{tum_folder}")
    assert peers_command([*source, "--result", *results, "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "orb-slam3" in shown and "5/5" in shown and "4/5" in shown
    rows = json.loads(out.read_text())["rows"]
    assert [(row["peer"], row["values"]["scored"]) for row in rows] == [
        ("orb-slam3", 5),
        ("rtabmap", 4),
    ]
    assert rows[0]["values"]["ate_cm"] < 1e-6
    assert "| rtabmap |" in out.with_suffix(".md").read_text()


def test_a_folder_of_results_has_its_sequences_scored(tum_folder: Path, tmp_path: Path, capsys):
    truth = open_ground_truth(f"tum:{tum_folder}")
    assert truth is not None
    data = tmp_path / "data"
    data.mkdir()
    tum_folder.rename(data / "kitchen")
    (tmp_path / "others" / "kitchen").mkdir(parents=True)
    write_tum(tmp_path / "others" / "kitchen" / "elastic.txt", truth.trajectory)
    given = ("--results", str(tmp_path / "others"), "--data", str(data), "--no-run")
    assert peers_command([*given, "--out", str(tmp_path / "peers.json")]) == 0
    shown = capsys.readouterr().out
    assert "skipped house:" in shown and "is not on disk" in shown
    assert "kitchen elastic: ATE 0.000 cm" in shown


def test_the_table_does_not_replace_the_results(tmp_path: Path):
    with pytest.raises(UserError, match=r"x\.md: expected a name that ends in \.json"):
        peers_command(["--source", "synth:room", "--out", str(tmp_path / "x.md")])


def test_a_result_of_another_time_base_has_failed(tum_folder: Path, tmp_path: Path, capsys):
    truth = open_ground_truth(f"tum:{tum_folder}")
    assert truth is not None
    late = Trajectory(truth.stamps_ns + 86_400_000_000_000, truth.trajectory.T_world_cam)
    write_tum(tmp_path / "late.txt", late)
    given = ("--no-run", "--source", f"tum:{tum_folder}", "--result", f"a={tmp_path / 'late.txt'}")
    assert peers_command([*given, "--out", str(tmp_path / "peers.json")]) == 1
    assert "late.txt: none of its poses" in capsys.readouterr().out


def test_a_bad_result_is_refused_before_a_peer_runs(tum_folder: Path, tmp_path: Path):
    (tmp_path / "bad.txt").write_text("1 2 3\n")
    given = ("--source", f"tum:{tum_folder}", "--result", f"a={tmp_path / 'bad.txt'}")
    with pytest.raises(UserError, match=r"bad\.txt:1: "):
        peers_command([*given, "--out", str(tmp_path / "peers.json")])
    assert not (tmp_path / "peers").exists()


def test_nothing_to_measure_is_no_success(tmp_path: Path, capsys):
    given = ("--data", str(tmp_path), "--peers", "opencv-frames")
    assert peers_command([*given, "--out", str(tmp_path / "peers.json")]) == 1
    assert "nothing was measured" in capsys.readouterr().out


@pytest.mark.e2e
def test_a_peer_runs_in_a_process_of_its_own(tmp_path: Path):
    options = ("--source", "synth:room", "--frames", "8", "--peers", "opencv-frames")
    command = [sys.executable, "-m", "hsslam_bench", "peers", *options]
    out = tmp_path / "peers.json"
    done = subprocess.run([*command, "--out", str(out)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(out.read_text())["rows"]
    assert row["values"]["scored"] == row["values"]["expected"] == 8
    assert row["values"]["ate_cm"] < 1 and row["values"]["fps"] > 0
    assert (out.with_suffix("") / "synth-room-opencv-frames" / "trajectory.txt").is_file()


def test_a_peer_that_fails_costs_its_row_alone(tmp_path: Path, capsys):
    (tmp_path / "house").mkdir()  # there, but empty
    where = ("--data", str(tmp_path), "--out", str(tmp_path / "peers.json"))
    assert peers_command(["--sequences", "house", "--peers", "opencv-frames", *where]) == 1
    shown = capsys.readouterr().out
    assert "house OpenCV odometry, frame to frame: ended with code 2: error: " in shown
    assert "failed" in shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--peers", "opencv-frame"], r"--peers opencv-frame: .*did you mean opencv-frames\?"),
        (["--result", "a=t.txt"], "--result: expected with --source"),
        (["--no-run"], "nothing to score"),
        (["--noise", "kinect"], "write house-kinect"),
        (["--source", "synth:room", "--results", "x"], "expected --result with --source"),
        (["--no-run", "--source", "synth:room", "--result", "a=/no.txt"], "no.txt: cannot be read"),
        (["--data", "/no/data"], "--data /no/data: no such folder"),
        (["--no-run", "--results", "/no/results"], "--results /no/results: no such folder"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], message: str, tmp_path: Path):
    with pytest.raises(UserError, match=message) as error:
        peers_command([*arguments, "--out", str(tmp_path / "peers.json")])
    assert "\n" not in str(error.value)
