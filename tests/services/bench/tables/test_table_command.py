"""The command as a user types it, on runs that are too small to mean anything."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_node.services.bench.tables.command import table_command

_TINY = ("mapper.first_iterations=20", "mapper.rays=256", "mesher.final_voxel_m=0.1")


def _bench(*arguments: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "hsslam_node.services.bench", *arguments]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.mark.e2e
def test_a_run_that_fails_costs_nothing_else_and_nothing_is_run_twice(tmp_path: Path):
    (tmp_path / "house").mkdir()  # there, but empty
    out = tmp_path / "out/table.json"
    small = ("--frames", "4", "--preset", "realtime", "--set", *_TINY)
    where = ("--data", str(tmp_path), "--out", str(out))
    options = ("--rows", "full", "D", "--seeds", "0", "--sequences", "house", "room", "kitchen")
    result = _bench("ablation", *options, *small, *where)
    assert result.returncode == 1, result.stderr
    assert "skipped kitchen: " in result.stdout and "is not on disk" in result.stdout
    assert "D-house-seed0: ended with code 2: error: " in result.stdout
    runs = json.loads(out.read_text())["runs"]
    assert [(run["row"], run["sequence"]) for run in runs] == [
        *(("full", "house"), ("full", "room")),
        *(("D", "house"), ("D", "room")),
    ]
    good = [run for run in runs if not run["error"]]
    assert {run["sequence"] for run in good} == {"room"}
    for run in good:
        assert run["values"]["lost"] == 0 and run["values"]["ate_cm"] < 5
        assert {"accuracy_cm", "completion_pct", "ate_online_cm", "fps"} <= run["values"].keys()
    assert good[0]["values"]["model_mib"] > good[1]["values"]["model_mib"]
    markdown = out.with_suffix(".md").read_text()
    assert "| (D) without hash grid |" in markdown and "(0.558)" in markdown
    assert "preset realtime; mapper.first_iterations=20" in markdown

    before = out.read_text()
    shown = _bench("ablation", "--show", *options, *small, *where, "--data", str(tmp_path / "no"))
    assert "(D) without hash grid" in shown.stdout.replace("\n", " ")
    assert out.read_text() == before
    folder = out.with_suffix("") / "D-room-seed0"
    online = (folder / "trajectory_online.txt").read_text()
    (folder / "trajectory_online.txt").write_text("\n".join(online.splitlines()[:-1]) + "\n")
    last = ("--rows", "D", "--seeds", "0", "--sequences", "room")
    assert _bench("ablation", "--rescore", *last, *small, *where).returncode == 0
    after = {(run["row"], run["sequence"]): run for run in json.loads(out.read_text())["runs"]}
    ours, old = after["D", "room"], good[1]
    assert ours["details"]["evaluation"]["ate"]["online"]["scored"] == 3
    assert ours["values"]["ate_cm"] == old["values"]["ate_cm"] and ours["scored_by"]
    assert ours["values"]["fps"] == old["values"]["fps"]
    before = out.read_text()
    if not good[0]["commit"].endswith("+"):  # else the files may be others by now
        again = _bench(
            "ablation", "--rows", "full", "--seeds", "0", "--sequences", "room", *small, *where
        )
        assert again.returncode == 0, again.stderr
        assert "full-room-seed0: kept from an earlier call" in again.stdout
        assert out.read_text() == before


@pytest.mark.parametrize("table", ["replica", "tum", "scannet", "ablation"])
def test_what_is_not_on_disk_is_skipped_and_told(table, tmp_path, capsys):
    assert table_command(table, ["--data", str(tmp_path), "--out", str(tmp_path / "o.json")]) == 0
    told = capsys.readouterr().out
    assert (
        told.count("is not on disk") == {"replica": 8, "tum": 3, "scannet": 6, "ablation": 1}[table]
    )
    assert "nothing was measured" in told


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--row", "A"], "did you mean --rows"),
        (["--rows", "Z"], "--rows Z: expected some of full, A, B"),
        (["--set", "mapper.ray=3"], r"did you mean mapper\.rays\?"),
        (["--seeds", "-1"], "--seeds -1: expected numbers from 0"),
        (["--frames", "0"], "frames"),
        (["--preset", "fast"], "realtime"),
    ],
)
def test_bad_input_is_one_line(arguments, message, tmp_path):
    with pytest.raises(UserError, match=message) as told:
        table_command("ablation", [*arguments, "--out", str(tmp_path / "o.json")])
    assert "\n" not in str(told.value)


def test_sequences_are_rows_of_the_other_tables():
    with pytest.raises(UserError, match="expected --rows"):
        table_command("tum", ["--sequences", "house"])
