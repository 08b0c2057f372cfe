"""`hsslam-batch` tells what it has, and what is missing; what is not asked for is not imported."""

import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_batch.__main__ import main
from hsslam_batch.attempt.commit import commit
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.results.runs_table import write_runs
from tests.batch.outcomes import outcome, planned, run_folder


def _run(*args: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["hsslam-batch", *args])
    return main()


def test_help_lists_the_commands(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    assert _run(monkeypatch=monkeypatch) == 0
    shown = capsys.readouterr().out
    assert all(f"hsslam-batch {name} " in shown for name in ("plan", "run", "work", "report"))
    assert _run("rnu", monkeypatch=monkeypatch) == 2
    assert "rnu: expected plan, run, work, report, status; did you mean run?" in (
        capsys.readouterr().err
    )


def test_without_the_extra_one_line_says_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    batch = planned(tmp_path / "out")
    monkeypatch.setitem(sys.modules, "ray", None)  # as if it were not installed
    assert _run("run", str(batch.out), monkeypatch=monkeypatch) == 2
    assert capsys.readouterr().err == (
        "error: run: package ray is missing: expected pip install 'hsslam-node[batch]'\n"
    )
    assert _run("status", str(batch.out), monkeypatch=monkeypatch) == 1
    assert "3 logs: 0 done, 0 failed, 3 left" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("modules", "without"),
    [
        ("hsslam_batch.cluster.task, hsslam_batch.cluster.board", {"numpy", "torch", "ray"}),
        ("hsslam_batch.cluster.command, hsslam_batch.attempt.command", {"torch", "ray", "fsspec"}),
    ],
)
def test_what_a_worker_and_the_commands_import(modules: str, without: set[str]):
    code = f"import {modules}, sys; print(sorted({without!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("command", ["run", "status"])
def test_a_batch_without_anything_left_is_counted_with_few_imports(tmp_path: Path, command: str):
    batch = planned(tmp_path / "out", frames=(100,))
    commit(batch, outcome(batch, 0), run_folder(batch, 0))
    write_runs(batch, read_manifest(batch.out))
    slow = {"ray", "torch", "numba", "cv2", "pandas", "fsspec", "matplotlib"}
    code = (
        f"import sys; sys.argv[1:] = [{command!r}, {str(batch.out)!r}]; "
        "from hsslam_batch.__main__ import main; code = main(); "
        f"print(code, sorted({slow!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    counts, end = done.stdout.splitlines()
    assert counts.startswith("1 ") and end == "0 []"
