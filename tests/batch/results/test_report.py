"""The report shows sums, the worst logs, and what changed against another batch beyond noise."""

import shutil
from pathlib import Path

import pytest

from hsslam_batch.attempt.commit import commit, settle_failed
from hsslam_batch.attempt.outcome import Kind
from hsslam_batch.plan.batch import Batch
from hsslam_batch.results.comparison import FIGURES, compare
from hsslam_batch.results.costs import costs
from hsslam_batch.results.report import report_command
from hsslam_batch.results.runs_table import read_runs
from hsslam_batch.results.status import status_command
from hsslam_node.errors import UserError
from tests.batch.outcomes import outcome, planned, run_folder


def _batch(out: Path, ates_m: tuple[float | None, ...], lost: int = 0) -> Batch:
    batch = planned(out, frames=(100,) * len(ates_m))
    for k, ate_m in enumerate(ates_m):
        row = outcome(batch, k, frames=100, tracked=100 - lost, lost=lost, ate_m=ate_m, core_s=5.0)
        commit(batch, row, run_folder(batch, k))
    return batch


def test_sums_and_worst_logs(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    batch = _batch(tmp_path / "out", (0.01, 0.03, 0.02), lost=1)
    assert report_command([str(batch.out), "--worst", "2"]) == 0
    shown = capsys.readouterr().out
    assert "3 logs: 3 done\n300 frames, 3 lost (1.00 %); core time 15 s, 50 ms a frame" in shown
    ates = [line.split() for line in shown.splitlines() if "log" in line and "ATE" in line]
    assert ates and "log1" in ates[0] and "3" in ates[0]
    assert (batch.out / "runs.parquet").exists()


def test_long_names_of_logs_are_whole(tmp_path: Path, capsys, monkeypatch):
    name, shown = "2026-11-30/robot-7/" + 20 * "a_long_walk/" + "run.mcap", {}
    before, after = (planned(tmp_path / out, frames=(100,)) for out in ("before", "after"))
    for batch, ate_m in ((before, 0.01), (after, 0.05)):
        done = outcome(batch, 0, frames=100, tracked=100, core_s=5.0, name=name, ate_m=ate_m)
        commit(batch, done, run_folder(batch, 0))
    for terminal in ("", "1"):  # a terminal has 80 columns here
        monkeypatch.setenv("FORCE_COLOR", terminal)
        monkeypatch.setenv("COLUMNS", "80")
        for words in ([], ["--against", str(before.out)]):
            report_command([str(after.out), *words])
            shown[terminal, len(words)] = capsys.readouterr().out
    assert all(name in text for (terminal, _), text in shown.items() if not terminal)
    assert not any("…" in text for text in shown.values())


def test_core_time_of_failed_logs_is_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    batch = planned(tmp_path / "out", frames=(100, 100))
    settle_failed(batch, outcome(batch, 1, "crash", frames=40, core_s=80.0))
    assert report_command([str(batch.out)]) == 0
    failed = "core time of failed logs: 80 s (only the last attempt of each)\n"
    assert capsys.readouterr().out == f"1 logs: 1 crash\n{failed}"
    commit(batch, outcome(batch, 0, frames=100, core_s=5.0), run_folder(batch, 0))
    assert report_command([str(batch.out)]) == 0
    assert f"core time 5 s, 50 ms a frame\n{failed}" in capsys.readouterr().out


def test_a_batch_that_has_not_run_and_one_that_is_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    new, old = planned(tmp_path / "new", frames=(100,)), planned(tmp_path / "old", frames=(100,))
    assert report_command([str(new.out)]) == 0
    assert capsys.readouterr().out == "0 logs: none has run\n"
    with pytest.raises(UserError, match=r"results of none of these logs \(0 against 0 rows\)"):
        report_command([str(new.out), "--against", str(old.out)])
    with pytest.raises(UserError, match=r"nowhere.*expected a folder"):
        report_command([str(new.out), "--against", str(tmp_path / "nowhere")])
    assert capsys.readouterr().out == ""


def test_what_logs_cost_by_kind_of_source_and_in_total(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    def row(source: str, log_s: float, core_s: float, kind: str = "done"):
        figures = {
            "frames": 30 * int(log_s),
            "log_s": log_s,
            "core_s": core_s,
            "wall_s": core_s / 2,
        }
        return {"source": source, "kind": kind, **figures}

    bad = row("mcap:/d", 60.0, 1.0, "crash")
    unknown = row("mcap:/e", 0.0, 1.0)
    rows = [row("mcap:/a", 30.0, 40.0), row("mcap:/b", 30.0, 20.0), row("tum:/c", 60.0, 180.0)]
    found = {cost.source: cost for cost in costs([*rows, bad, unknown])}
    assert {name: (c.logs, c.core_s_a_minute) for name, c in found.items()} == {
        "mcap": (2, 60.0),
        "tum": (1, 180.0),
        "all": (3, 120.0),
    }
    assert found["all"].wall_s_a_minute == 60.0
    assert round(found["tum"].core_ms_a_frame) == 100
    assert [cost.source for cost in costs(rows[:2])] == ["mcap"] and costs([bad]) == []
    batch = planned(tmp_path / "out", frames=(100,))
    commit(batch, outcome(batch, 0, log_s=30.0, frames=900, core_s=45.0), run_folder(batch, 0))
    assert report_command([str(batch.out)]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if "mcap" in line)
    assert [cell.strip() for cell in line.split("│")[2:6]] == ["1", "0.5", "45", "90"]


def test_pictures_of_all_logs_and_of_what_changed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    before = _batch(tmp_path / "a", (0.01, 0.02, 0.02, 0.03))
    after = _batch(tmp_path / "b", (0.01, 0.05, 0.02, 0.02))
    plots = tmp_path / "plots"
    command = [str(after.out), "--plots", str(plots)]
    assert report_command(command) == 0
    assert [path.name for path in plots.iterdir()] == ["logs.png"]
    assert report_command([*command, "--against", str(before.out)]) == 1
    assert sorted(path.name for path in plots.iterdir()) == ["changes.png", "logs.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in plots.iterdir())
    assert f"plot: {plots / 'changes.png'}" in capsys.readouterr().out
    nothing = planned(tmp_path / "c")
    with pytest.raises(UserError, match=r"--plots .*: no log is done: expected at least one"):
        report_command([str(nothing.out), "--plots", str(plots)])
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match=r"--plots .*file: .*: expected a folder to write"):
        report_command([str(after.out), "--plots", str(tmp_path / "file")])


def test_a_log_that_got_worse_ends_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    before = _batch(tmp_path / "a", (0.01, 0.02, 0.02, 0.03))
    same = _batch(tmp_path / "b", (0.0105, 0.02, 0.019, 0.03))
    assert report_command([str(same.out), "--against", str(before.out)]) == 0
    assert "1.000" in capsys.readouterr().out
    worse = _batch(tmp_path / "c", (0.01, 0.05, 0.02, 0.03))
    settle_failed(worse, outcome(worse, 3, "crash"))  # is done: stays so
    worse.done_file("id3").unlink()
    settle_failed(worse, outcome(worse, 3, "crash", reason="killed by SIGSEGV"))
    assert report_command([str(worse.out), "--against", str(before.out)]) == 1
    shown = capsys.readouterr().out
    assert "log1 2 -> 5" in shown
    assert "log3: was done, now crash: killed by SIGSEGV" in shown
    with pytest.raises(UserError, match="--noise -1: expected a fraction"):
        report_command([str(worse.out), "--noise", "-1"])


def test_the_earlier_batch_is_only_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    before = _batch(tmp_path / "a", (0.01, 0.02))
    worse = _batch(tmp_path / "b", (0.01, 0.05))
    command = [str(worse.out), "--against", str(before.out)]
    assert report_command(command) == 1
    table = before.out / "runs.parquet"
    assert not table.exists()
    assert report_command([str(before.out)]) == 0
    written = table.read_bytes()
    shutil.rmtree(before.run_dir("id1"))  # its figures are in the table
    assert report_command(command) == 1 and table.read_bytes() == written
    assert capsys.readouterr().out.count("log1 2 -> 5") == 2


def test_a_report_keeps_the_rows_of_results_that_were_removed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    batch = _batch(tmp_path / "a", (0.01, 0.02))
    assert report_command([str(batch.out)]) == 0
    shutil.rmtree(batch.out / "runs")
    for _ in range(2):
        assert report_command([str(batch.out)]) == 0
        assert [row["name"] for row in read_runs(batch.out)] == ["log0", "log1"]
    (batch.out / "runs.parquet").write_bytes(b"damaged")
    assert report_command([str(batch.out)]) == 0
    assert read_runs(batch.out) == []


def test_batches_of_other_logs_are_not_compared(tmp_path: Path):
    mine, other = _batch(tmp_path / "a", (0.01,)), _batch(tmp_path / "b", (0.01, 0.02))
    shutil.rmtree(other.run_dir("id0"))
    with pytest.raises(UserError, match=r"--against .*b: has results of none of these logs"):
        report_command([str(mine.out), "--against", str(other.out)])


def test_a_figure_that_is_gone_ends_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    before = _batch(tmp_path / "a", (0.01, 0.02, None))
    without = _batch(tmp_path / "b", (None, None, None))
    assert report_command([str(without.out), "--against", str(before.out), "--worst", "1"]) == 1
    shown = capsys.readouterr().out
    assert "2 logs have no ATE any more: log0, ...\n" in shown
    assert report_command([str(before.out), "--against", str(without.out)]) == 0
    without.done_file("id1").unlink()
    settle_failed(without, outcome(without, 1, "crash"))
    assert report_command([str(without.out), "--against", str(before.out)]) == 1
    shown = capsys.readouterr().out
    assert "1 log has no ATE any more: log0\n" in shown and "log1: was done" in shown


def test_what_is_beyond_noise():
    def rows(**values: list[float | None]):
        (name,) = values
        return [
            {"name": f"log{k}", "kind": "done"} | {f.column: None for f in FIGURES} | {name: value}
            for k, value in enumerate(values[name])
        ]

    before = rows(ate_m=[0.01, 0.01, 0.0001, None, 0.0])
    after = rows(ate_m=[0.0119, 0.0121, 0.0003, 0.5, 0.001])
    (change,) = [c for c in compare(before, after, 0.2) if c.pairs]
    assert [pair.name for pair in change.worse] == ["log4", "log1"]  # log2 is too small to matter
    (other,) = [c for c in compare(after, before, 0.2) if c.pairs]
    assert other.better == 2 and other.worse == []


def test_a_log_that_is_left_is_neither_failed_nor_worse(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """One has attempts left, one could not be fetched; `status` counts both as left."""
    before = _batch(tmp_path / "a", (0.01, 0.02, 0.03))
    after = _batch(tmp_path / "b", (0.01, 0.02, 0.03))
    assert report_command([str(after.out)]) == 0
    lefts: tuple[tuple[int, Kind], ...] = ((1, "crash"), (2, "unavailable"))
    for k, kind in lefts:
        after.done_file(f"id{k}").unlink()
        settle_failed(after, outcome(after, k, kind, reason="why", retries=2))
    assert status_command([str(after.out)]) == 1
    capsys.readouterr()
    assert report_command([str(after.out), "--against", str(before.out)]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("1 logs: 1 done\n") and "was done" not in shown
    assert shown.endswith("2 logs are done or failed in only one of the two batches\n")
    assert [row["name"] for row in read_runs(after.out)] == ["log0"]
