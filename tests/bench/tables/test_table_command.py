"""The command as a user types it, on runs that are too small to mean anything."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_bench.tables.command import table_command
from hsslam_node.errors import UserError

_TINY = ("mapper.first_iterations=20", "mapper.rays=256", "mesher.final_voxel_m=0.1")


@pytest.mark.long
def test_a_run_that_fails_costs_nothing_else_and_nothing_is_run_twice(tmp_path: Path, capsys):
    (tmp_path / "house").mkdir()  # there, but empty
    out = tmp_path / "out/table.json"
    small = ("--frames", "4", "--preset", "realtime", "--set", *_TINY)
    where = ("--data", str(tmp_path), "--out", str(out))
    options = ("--rows", "D", "--seeds", "0", "--sequences")
    every, room = (*options, "house", "room", "kitchen"), (*options, "room")
    command = [sys.executable, "-m", "hsslam_bench", "ablation"]
    result = subprocess.run([*command, *every, *small, *where], capture_output=True, text=True)
    assert result.returncode == 1, result.stderr
    assert "skipped kitchen: " in result.stdout and "is not on disk" in result.stdout
    assert "D-house-seed0: ended with code 2: error: " in result.stdout
    failed, good = json.loads(out.read_text())["runs"]
    assert [(run["row"], run["sequence"]) for run in (failed, good)] == [
        ("D", "house"),
        ("D", "room"),
    ]
    assert failed["error"] and not good["error"]
    assert good["values"]["lost"] == 0 and good["values"]["ate_cm"] < 5
    assert {"accuracy_cm", "completion_pct", "ate_online_cm", "fps"} <= good["values"].keys()
    assert {"accuracy_lit_cm", "completion_lit_pct"} <= good["values"].keys()
    assert good["details"]["model_bytes"].get("hash", 0) == 0  # what (D) is without
    markdown = out.with_suffix(".md").read_text()
    assert "| (D) without hash grid |" in markdown and "(0.558)" in markdown
    assert "preset realtime; mapper.first_iterations=20" in markdown

    def again(*arguments: str) -> tuple[int, str]:
        code = table_command("ablation", [*small, *where, *arguments])
        return code, capsys.readouterr().out

    before = out.read_text()
    elsewhere = ("--data", str(tmp_path / "no"))
    assert "(D) without hash grid" in again("--show", *every, *elsewhere)[1].replace("\n", " ")
    assert out.read_text() == before
    (folder,) = out.with_suffix("").glob("D-room-seed0-*")
    online = folder / "trajectory_online.txt"
    online.write_text("\n".join(online.read_text().splitlines()[:-1]) + "\n")
    assert again("--rescore", *room)[0] == 0
    scored = {run["sequence"]: run for run in json.loads(out.read_text())["runs"]}["room"]
    assert scored["details"]["evaluation"]["ate"]["online"]["scored"] == 3
    assert scored["values"]["ate_cm"] == good["values"]["ate_cm"] and scored["scored_by"]
    assert scored["values"]["fps"] == good["values"]["fps"]
    before = out.read_text()
    if not good["commit"].endswith("+"):  # else the files may be others by now
        code, told = again(*room)
        assert code == 0 and "D-room-seed0: kept from an earlier call" in told
        assert out.read_text() == before


@pytest.mark.parametrize("table", ["replica", "tum", "scannet", "ablation"])
def test_what_is_not_on_disk_is_skipped_and_told(table, tmp_path, capsys):
    assert table_command(table, ["--data", str(tmp_path), "--out", str(tmp_path / "o.json")]) == 1
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
