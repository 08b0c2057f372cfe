"""Results of the run before in a folder: no run loses them that has none of its own."""

import shutil
from pathlib import Path

import pytest

from hsslam_services.artefacts.replaced_results import ReplacedResults
from tests.services.serve_process import SMALL_ROOM


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    """The folder of a run that ended, with a file of the user's."""
    folder = tmp_path / "site"
    for name in ("logs", "evaluation"):
        (folder / name).mkdir(parents=True)
    (folder / "run.json").write_text('{"run_id": "20260101-000000-abcdef"}')
    (folder / "summary.json").write_text('{"exit_code": 0}')
    maps = ("map.safetensors", "map_fragment_1.safetensors")
    results = (*maps, "run.mcap", "trajectory.txt")
    for name in (*results, "logs/mapper.log", "evaluation/error.png", "mine.txt"):
        (folder / name).write_text(f"{name} of before")
    return folder


def _content(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): path.read_bytes().decode(errors="replace")
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_results_go_back_if_the_next_run_is_refused(run_dir: Path):
    before = _content(run_dir)
    results = ReplacedResults(run_dir)
    results.set_aside()
    assert [path.name for path in run_dir.iterdir() if path.is_file()] == ["mine.txt"]
    (run_dir / "logs").mkdir()
    for name in ("run.json", "summary.json", "trajectory.txt", "run.rrd", "logs/tracker.log"):
        (run_dir / name).write_text("of the run that is refused")
    results.give_back()
    assert _content(run_dir) == before
    assert not results.exists


def test_results_go_once_the_next_run_has_poses(run_dir: Path):
    results = ReplacedResults(run_dir)
    results.set_aside()
    (run_dir / "trajectory.txt").write_text("new")
    assert results.replace() == ""
    assert _content(run_dir) == {"mine.txt": "mine.txt of before", "trajectory.txt": "new"}


def test_results_that_are_being_removed_are_not_kept_and_the_next_run_removes_the_rest(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch
):
    results = ReplacedResults(run_dir)
    results.set_aside()
    with monkeypatch.context() as killed:
        killed.setattr(shutil, "rmtree", lambda *_, **__: None)
        assert results.replace() == ""
        assert ReplacedResults(run_dir).keep() == ""
        assert not ReplacedResults(run_dir).exists
    (run_dir / "trajectory.txt").write_text("new")
    assert ReplacedResults(run_dir).replace() == ""
    assert _content(run_dir) == {"mine.txt": "mine.txt of before", "trajectory.txt": "new"}


@pytest.mark.parametrize("exit_code", [3, 4, None])  # None: it was killed
def test_results_of_a_run_that_did_not_end_in_order_stay(run_dir: Path, exit_code: int | None):
    (run_dir / "summary.json").write_text(
        "{}" if exit_code is None else f'{{"exit_code": {exit_code}}}'
    )
    before = _content(run_dir)
    results = ReplacedResults(run_dir)
    results.set_aside()
    (run_dir / "trajectory.txt").write_text("new")
    assert results.replace() == "earlier"
    assert _content(run_dir / "earlier") | {"mine.txt": "mine.txt of before"} == before
    assert (run_dir / "trajectory.txt").read_text() == "new"
    assert results.replace() == ""


@pytest.mark.parametrize("has_results", [False, True])
def test_results_come_back_after_a_run_that_was_killed_at_its_start(
    run_dir: Path, has_results: bool
):
    before = _content(run_dir)
    ReplacedResults(run_dir).set_aside()
    (run_dir / "run.json").write_text("of the run that was killed")
    if has_results:
        (run_dir / "trajectory.txt").write_text("saved by its watchdog")
    ReplacedResults(run_dir).recover()
    assert not ReplacedResults(run_dir).exists
    if not has_results:
        assert _content(run_dir) == before
        return
    kept = _content(run_dir / "earlier")  # no version of ours wrote this run.json
    assert kept == {name: text for name, text in before.items() if name != "mine.txt"}
    assert (run_dir / "trajectory.txt").read_text() == "saved by its watchdog"


def test_what_was_kept_before_stays(run_dir: Path):
    for text in ("first", "second"):
        (run_dir / "run.json").write_text("no run of this version")
        (run_dir / "trajectory.txt").write_text(text)
        results = ReplacedResults(run_dir)
        results.set_aside()
        results.keep()
    assert (run_dir / "earlier" / "trajectory.txt").read_text() == "first"
    assert (run_dir / "earlier-2" / "trajectory.txt").read_text() == "second"


def test_without_results_nothing_is_set_aside(tmp_path: Path):
    results = ReplacedResults(tmp_path)
    results.set_aside()
    assert not results.exists
    results.recover()
    assert results.keep() == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.e2e
def test_a_log_that_cannot_be_read_costs_no_results(serve, tmp_path: Path):
    first = serve(*SMALL_ROOM, "--frames", "10")
    assert first.finish() == 0, first.stderr
    before = _content(first.out)
    cut = tmp_path / "cut.mcap"
    shutil.copy(first.out / "run.mcap", cut)
    with cut.open("r+b") as file:
        file.truncate(200)
    second = serve("--source", f"mcap:{cut}", "--out", str(first.out))
    assert second.finish() == 2, second.stderr
    assert "cut.mcap" in second.stderr
    assert _content(first.out) == before
