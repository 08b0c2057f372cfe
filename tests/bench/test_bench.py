"""The benchmark on runs that are too small to mean anything, and what is done with its results."""

import dataclasses
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from hsslam_bench.__main__ import main
from hsslam_bench.checks.catalogue import catalogue
from hsslam_bench.checks.check import select
from hsslam_bench.result_commands import RESULT_COMMANDS
from hsslam_bench.results.compare import circumstances, pairs
from hsslam_bench.results.report import read_report, report, with_rows
from hsslam_bench.runs.session import Session
from hsslam_bench.tables.paper_tables import TABLES
from tests.bench.result_files import row_of, stored
from tests.in_process import run_main

_TINY = (
    *("--synth.width-px", "160", "--synth.height-px", "120"),
    *("--slam.mapper.first-iterations", "20", "--slam.mapper.rays", "256"),
    *("--slam.ba.rays", "256", "--slam.mesher.final-voxel-m", "0.08", "--no-evaluate"),
)
_MOMENT = ("--frames", "12")
_SECONDS = ("--frames", "75")  # long enough that every process is seen at work


@pytest.mark.e2e
def test_figures_of_a_real_run_and_a_bound_that_is_not_met(tmp_path: Path):
    names = ("log", "left-behind", "stages", "realtime:room:tracked")
    ratios = ("min-inlier-ratio", "lag-coverage", "relocalisation-coverage")
    nothing_is_good_enough = [o for name in ratios for o in (f"--slam.tracker.{name}", "1.0")]
    only = ("--data", str(tmp_path), "--only", *names)  # no sequence on disk but the built-in room
    result = _bench(tmp_path, "--quick", *only, "--", *_TINY, *_MOMENT, *nothing_is_good_enough)
    assert result.returncode == 1, result.stderr
    stored = json.loads((tmp_path / "result.json").read_text())
    verdicts = {row["name"]: (row["verdict"], row["measured"]) for row in stored["rows"]}
    assert verdicts["realtime:room:tracked"][0] == "NOT MET"
    assert {name: verdicts[name][0] for name in ("log:messages", "log:rerun", "left-behind")} == {
        "log:messages": "ok",
        "log:rerun": "ok",
        "left-behind": "ok",
    }, verdicts
    assert "track" in verdicts["stages"][1]
    assert "NOT MET" in result.stdout
    assert stored["protocol"]["extra_options"] == [*_TINY, *_MOMENT, *nothing_is_good_enough]
    assert stored["runs"][0]["summary"]["frames"]["in"] == 12
    assert stored["machine"]["cores"] >= 1
    assert not list((tmp_path / "result").glob("*/run.mcap"))


@pytest.mark.e2e
@pytest.mark.long
def test_a_viewer_is_attached_and_core_time_is_counted(tmp_path: Path):
    names = ("viewer:room:tracked", "viewer:room:iterations", "budget")
    data = ("--data", str(tmp_path))
    result = _bench(tmp_path, "--quick", *data, "--only", *names, "--", *_TINY, *_SECONDS)
    path = tmp_path / "result.json"
    rows = {row.name: row for row in read_report(path).rows}
    assert rows["viewer:room:tracked"].values["viewer_bytes"] > 1e4, result.stdout
    assert rows["viewer:room:iterations"].figure is not None, result.stdout
    used_ms = rows["budget"].values["viewer-room"]
    assert {"tracker", "recorder"} <= used_ms.keys()
    (run,) = read_report(path).runs
    assert "viewer" in run["usage"][-1]["cpu_s"]
    assert [pose[0] for pose in run["log"]["poses"]] == sorted(p[0] for p in run["log"]["poses"])
    assert run["disk_bytes"]["run.mcap"] > 0
    memory = [sample["pss_bytes"] for sample in run["usage"] if sample["pss_bytes"]]
    assert memory and all(size > 0 for size in memory[-1].values())

    drawn = _run("plots", str(path), "--to", str(tmp_path / "plots"))
    assert drawn.returncode == 0, drawn.stderr
    assert sorted(p.name for p in (tmp_path / "plots").iterdir()) == ["latency.png", "stages.png"]
    compared = _run("compare", str(path), str(path))
    assert compared.returncode == 0, compared.stderr
    assert "budget viewer-room tracker" in compared.stdout


def test_sequences_that_are_not_on_disk_are_skipped_and_told(tmp_path: Path):
    only = ("--only", "ate:house", "mesh", "paper", "--data", str(tmp_path))
    result = run_main(main, "--out", str(tmp_path / "result.json"), *only)
    assert (result.returncode, result.stderr) == (1, "error: no row could be measured\n")
    assert f"skipped ate:house: {tmp_path / 'house'} is not on disk" in result.stdout
    rows = read_report(tmp_path / "result.json").rows
    assert [row.verdict for row in rows] == ["skipped"] * 14


def test_a_run_that_fails_is_a_bound_that_is_not_met(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """And what it leaves behind is found, also if the folder of the results is not absolute."""
    words = ("--out", "result.json", "--quick", "--only", "realtime:room:tracked")
    worker = (sys.executable, "-c", "open(0).read()", str(tmp_path / "result/realtime-room"))
    with subprocess.Popen(worker, stdin=subprocess.PIPE) as left:
        monkeypatch.chdir(tmp_path)
        result = run_main(main, *words, "--", "--map", "/no/map.safetensors")
    assert result.returncode == 1
    stored = read_report(tmp_path / "result.json")
    (row,), (run,) = stored.rows, stored.runs
    assert row.verdict == "NOT MET"
    assert "error: --map /no/map.safetensors: " in row.measured
    assert run["left_behind"] == [f"process {left.pid}"]


def test_unknown_row_is_one_line(tmp_path: Path):
    result = run_main(main, "--only", "ate:hose")
    assert result.returncode == 2
    assert result.stderr.strip().startswith("error: --only ate:hose")
    assert "ate:house" in result.stderr
    assert result.stderr.count("\n") == 1


def test_wrong_options_of_the_runs_are_refused_before_a_row_is_measured(tmp_path: Path):
    result = run_main(main, "--out", str(tmp_path / "result.json"), "--", "--seed", "-1")
    assert result.returncode == 2
    assert result.stderr == "error: --seed -1: expected 0 or more\n"
    assert not (tmp_path / "result.json").exists()


def test_subcommands_are_listed_and_suggested():
    told = run_main(main, "--help").stdout
    for name in (*TABLES, "peers", *RESULT_COMMANDS):
        assert re.search(rf"^  .*\b{name}\b", told, re.M), name
    wrong = run_main(main, "tun")
    assert wrong.returncode == 2
    assert (
        wrong.stderr.endswith(" or options; did you mean tum?\n") and wrong.stderr.count("\n") == 1
    )


def test_groups_select_their_rows():
    names = [check.name for check in catalogue()]
    assert len(set(names)) == len(names)
    ordinary = [check.name for check in catalogue() if not check.by_name_only]
    assert [c.name for c in select(catalogue(), [])] == ordinary
    assert not any(name.startswith("faults:") for name in ordinary)
    assert len(select(catalogue(), ["faults"])) == sum(n.startswith("faults:") for n in names)
    chosen = [c.name for c in select(catalogue(), ["mesh", "realtime:kitchen"])]
    assert chosen == [n for n in names if n.startswith(("mesh:", "realtime:kitchen:"))]
    assert [c.name for c in select(catalogue(), ["ate:house"])] == ["ate:house"]


def test_names_of_the_rows_are_listed():
    listed = run_main(main, "--list")
    assert listed.stdout.split() == [check.name for check in catalogue()]


def test_figures_are_compared_as_ratios(tmp_path: Path):
    fast = dataclasses.replace(row_of("memory"), figure=1.0, better="lower")
    slow = dataclasses.replace(fast, figure=2.0, values={"not": "looked at", "number": 3})
    stages = dataclasses.replace(row_of("stages"), values={"run": {"track": 8.0, "same": True}})
    longer = dataclasses.replace(stages, values={"run": {"track": 10.0, "new": 1.0}})
    before = report(Session(tmp_path, tmp_path), [slow, stages, row_of("budget")])
    after = report(Session(tmp_path, tmp_path), [fast, longer])
    found = {pair.name: pair for pair in pairs(before, after)}
    assert {name: pair.ratio for name, pair in found.items()} == {
        "memory": 0.5,
        "stages run track": 1.25,
    }
    assert found["memory"].is_better
    assert found["stages run track"].is_better is None
    assert "only in A: budget" in circumstances(before, after)


def test_what_a_ratio_cannot_show_is_told(tmp_path: Path):
    was = dataclasses.replace(row_of("ate:house", "0.4 cm", "ok"), figure=0.004, better="lower")
    failed = dataclasses.replace(was, measured="code 3", verdict="NOT MET", figure=None, version=2)
    none_wrong = dataclasses.replace(row_of("memory", "0"), figure=0.0, better="lower")
    some_wrong = dataclasses.replace(none_wrong, figure=5.0, bound="9 GB")
    before = report(Session(tmp_path, tmp_path), [was, none_wrong])
    after = report(Session(tmp_path, tmp_path, extra=["--seed", "1"]), [failed, some_wrong])
    (pair,) = pairs(before, after)
    assert (pair.ratio, pair.is_better) == (math.inf, False)
    assert circumstances(before, after)[2:] == [
        "options of hsslam-serve: A none, B --seed 1: ratios may mislead",
        "ate:house: version differs: A 1, B 2",
        "ate:house: A ok, 0.4 cm; B NOT MET, code 3",
        f"memory: bound differs: A {none_wrong.bound}, B 9 GB",
    ]


def test_a_commit_that_changes_meanwhile_is_named_beside_that_of_the_start(tmp_path: Path):
    session = Session(tmp_path, tmp_path)
    begun = report(session)
    one = with_rows(begun, session, [row_of("memory")])
    assert (one.time, one.commit) == (begun.time, begun.commit) and len(one.rows) == 1
    elsewhere = msgspec.structs.replace(begun, commit="abc")
    two = with_rows(with_rows(elsewhere, session, one.rows), session, one.rows)
    assert two.commit == f"abc, {begun.commit}"


def test_results_of_another_version_are_refused(tmp_path: Path):
    path = stored(tmp_path / "1.json")
    path.write_text(path.read_text().replace('"version": 1', '"version": 2'))
    result = run_main(main, "compare", str(path), str(path))
    assert result.returncode == 2
    assert result.stderr.startswith(f"error: {path}: a result of version 2: expected version 1")
    assert result.stderr.count("\n") == 1


_COMMAND = [sys.executable, "-m", "hsslam_bench"]


def _bench(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    out = ("--out", str(folder / "result.json"))
    return _run(*out, *arguments)


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*_COMMAND, *arguments], capture_output=True, text=True)
