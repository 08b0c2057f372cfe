"""The benchmark on runs that are too small to mean anything, and the table in the document."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from hsslam_node.errors import UserError
from hsslam_node.services.bench.catalogue import catalogue
from hsslam_node.services.bench.check import Row, select
from hsslam_node.services.bench.compare import circumstances, pairs
from hsslam_node.services.bench.document import BEGIN, END, fill_document, with_tables
from hsslam_node.services.bench.kept_figures import keep
from hsslam_node.services.bench.newest_rows import read_for_documents
from hsslam_node.services.bench.report import machine, read_report, report, write_report
from hsslam_node.services.bench.session import Session

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
    result = _bench(tmp_path, "--only", "ate:house", "mesh", "paper", "--data", str(tmp_path))
    assert result.returncode == 0, result.stderr
    assert f"skipped ate:house: {tmp_path / 'house'} is not on disk" in result.stdout
    rows = read_report(tmp_path / "result.json").rows
    assert [row.verdict for row in rows] == ["skipped"] * 4


def test_a_run_that_fails_is_a_bound_that_is_not_met(tmp_path: Path):
    result = _bench(tmp_path, "--quick", "--only", "realtime:room:tracked", "--", "--seed", "-1")
    assert result.returncode == 1
    (row,) = read_report(tmp_path / "result.json").rows
    assert row.verdict == "NOT MET"
    assert row.measured.endswith("error: --seed -1: expected 0 or more")


def test_unknown_row_is_one_line(tmp_path: Path):
    result = _bench(tmp_path, "--only", "ate:hose")
    assert result.returncode == 2
    assert result.stderr.strip().startswith("error: --only ate:hose")
    assert "ate:house" in result.stderr
    assert "Traceback" not in result.stderr


def test_groups_select_their_rows():
    names = [check.name for check in catalogue()]
    assert len(set(names)) == len(names)
    assert [c.name for c in select(catalogue(), [])] == names
    chosen = [c.name for c in select(catalogue(), ["mesh", "realtime:kitchen"])]
    assert chosen == [n for n in names if n.startswith(("mesh:", "realtime:kitchen:"))]
    assert [c.name for c in select(catalogue(), ["ate:house"])] == ["ate:house"]


def test_names_of_the_rows_are_listed():
    listed = subprocess.run([*_COMMAND, "--list"], capture_output=True, text=True, check=True)
    assert listed.stdout.split() == [check.name for check in catalogue()]


def test_every_row_stands_in_the_results():
    text = (Path(__file__).parents[2] / "docs/results.md").read_text()
    table = text[text.index(BEGIN) : text.index(END)]
    assert [line.split("`")[1] for line in table.splitlines() if line.startswith("| `")] == [
        check.name for check in catalogue()
    ]


@pytest.mark.parametrize("name", ["results.md", "performance.md"])
def test_tables_of_the_documents_show_the_figures_that_are_kept(name: str):
    docs = Path(__file__).parents[2] / "docs"
    reports = [read_for_documents(path) for path in sorted((docs / "figures").glob("*.json"))]
    text = (docs / name).read_text()
    assert with_tables(text, name, reports) == text


def test_only_the_newest_figure_of_a_row_is_kept(tmp_path: Path):
    first = _stored(tmp_path / "1.json", _row("ate:house", "0.70 cm"), _row("memory", "3 GB"))
    gone = dataclasses.replace(_row("budget"), name="of:old")
    second = _stored(tmp_path / "2.json", _row("ate:house", "0.41 cm"), gone)
    earlier = msgspec.structs.replace(read_report(first), time="2026-01-02T03:04:05Z")
    write_report(first, earlier)
    folder = tmp_path / "figures"
    assert [path.name for path in keep(folder, [first])] == ["2026-01-02T030405Z.json"]
    old, new = map(read_report, keep(folder, [second]))
    assert [(row.name, row.measured) for row in old.rows] == [("memory", "3 GB")]
    assert [(row.name, row.measured) for row in new.rows] == [("ate:house", "0.41 cm")]
    renewed = msgspec.structs.replace(earlier, time="2027-01-02T03:04:05Z")
    write_report(first, renewed)
    assert [path.name for path in keep(folder, [first])] == ["2027-01-02T030405Z.json"]
    assert keep(folder, [second]) == sorted(folder.iterdir())  # older than what is there


def test_document_holds_what_was_measured_last(tmp_path: Path):
    document = tmp_path / "results.md"
    document.write_text(f"before\n{BEGIN}\nan earlier table\n{END}\nafter\n")
    first = _stored(tmp_path / "1.json", _row("ate:house", "0.70 cm", "NOT MET"), _row("memory"))
    second = _stored(
        tmp_path / "2.json",
        _row("ate:house", "0.41 cm", "ok"),
        _row("memory", "nothing on disk", "skipped"),
        _row("gpu:paper", "no device here", "not measured"),
    )
    fill_document(document, [first])
    assert "0.70 cm | **NOT MET** |" in document.read_text()
    fill_document(document, [first, second])
    text = document.read_text()
    assert text.startswith(f"before\n{BEGIN}\n| name")
    assert text.endswith(f"\n{END}\nafter\n")
    assert "an earlier table" not in text
    assert "| 0.41 cm | ok |" in text
    assert "0.70" not in text
    assert "nothing on disk" not in text
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert len(rows) == len(catalogue())
    assert sum("| not measured" in row for row in rows) == len(rows) - 2
    assert "| not measured: no device here |" in text
    again = text
    fill_document(document, [first, second])
    assert document.read_text() == again


def test_a_row_measured_against_another_bound_is_not_in_the_document(tmp_path: Path):
    document = tmp_path / "results.md"
    document.write_text(f"{BEGIN}\n{END}\n")
    row = dataclasses.replace(_row("memory", "9 GB"), bound="10 GB")
    fill_document(document, [_stored(tmp_path / "1.json", row)])
    assert "9 GB" not in document.read_text()


def test_document_holds_chosen_rows_and_their_values_by_run(tmp_path: Path):
    document = tmp_path / "performance.md"
    head, columns = "<!-- bench:rows budget memory -->", "<!-- bench:columns budget -->"
    document.write_text(f"one\n{head}\n{END}\ntwo\n{columns}\n{END}\nthree\n")
    used = {"viewer-room": {"tracker": 9.51, "saver": 0.01}, "viewer-kitchen": {"tracker": 8.0}}
    row = dataclasses.replace(_row("budget", "17.5"), values=used)
    fill_document(document, [_stored(tmp_path / "1.json", row)])
    first, _, second = document.read_text().partition("two\n")
    assert [line.split("`")[1] for line in first.splitlines() if line.startswith("| `")] == [
        "budget",
        "memory",
    ]
    assert "| row |  | viewer-room | viewer-kitchen |" in second
    assert "| `budget` | tracker | 9.5 | 8.0 |" in second
    assert "saver" not in second
    assert second.endswith(f"{END}\nthree\n")
    document.write_text(f"<!-- bench:rows bugdet -->\n{END}\n")
    with pytest.raises(UserError, match="budget"):
        fill_document(document, [])


def test_figures_are_compared_as_ratios(tmp_path: Path):
    fast = dataclasses.replace(_row("memory"), figure=1.0, better="lower")
    slow = dataclasses.replace(fast, figure=2.0, values={"not": "looked at", "number": 3})
    stages = dataclasses.replace(_row("stages"), values={"run": {"track": 8.0, "same": True}})
    longer = dataclasses.replace(stages, values={"run": {"track": 10.0, "new": 1.0}})
    before = report(Session(tmp_path, tmp_path), machine(), [slow, stages, _row("budget")])
    after = report(Session(tmp_path, tmp_path), machine(), [fast, longer])
    found = {pair.name: pair for pair in pairs(before, after)}
    assert {name: pair.ratio for name, pair in found.items()} == {
        "memory": 0.5,
        "stages run track": 1.25,
    }
    assert found["memory"].is_better
    assert found["stages run track"].is_better is None
    assert "only in A: budget" in circumstances(before, after)


def test_results_of_another_version_are_refused(tmp_path: Path):
    path = _stored(tmp_path / "1.json")
    path.write_text(path.read_text().replace('"version": 1', '"version": 2'))
    result = _run("compare", str(path), str(path))
    assert result.returncode == 2
    assert result.stderr.startswith(f"error: {path}: a result of version 2: expected version 1")
    assert "Traceback" not in result.stderr


def test_document_takes_no_try_outs(tmp_path: Path):
    document = tmp_path / "results.md"
    document.write_text(f"{BEGIN}\n{END}\n")
    quick = tmp_path / "quick.json"
    write_report(quick, report(Session(tmp_path, tmp_path, quick=True), machine(), []))
    with pytest.raises(UserError, match="--quick"):
        fill_document(document, [quick])
    with pytest.raises(UserError, match=r"missing\.json"):
        fill_document(document, [tmp_path / "missing.json"])
    document.write_text("no markers")
    with pytest.raises(UserError, match="bench:begin"):
        fill_document(document, [_stored(tmp_path / "1.json")])


_COMMAND = [sys.executable, "-m", "hsslam_node.services.bench"]


def _bench(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    out = ("--out", str(folder / "result.json"))
    return _run(*out, *arguments)


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*_COMMAND, *arguments], capture_output=True, text=True)


def _row(name: str, measured: str = "12", verdict="measured") -> Row:
    (check,) = (check for check in catalogue() if check.name == name)
    return Row(name, check.what, check.bound, measured, verdict)


def _stored(path: Path, *rows: Row) -> Path:
    write_report(path, report(Session(path.parent, path.parent), machine(), rows))
    assert read_report(path).rows == rows
    return path
