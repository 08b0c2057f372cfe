"""The results of the previous run stay until the new run cannot be refused, and no tick waits for them."""

import json
import time
from pathlib import Path

import pytest

from hsslam_services.artefacts.replaced_results import ReplacedResults
from hsslam_services.run.exit_code import ExitCode
from hsslam_services.supervisor.replacement import Replacement


@pytest.mark.parametrize(
    ("code", "kept"),
    [
        pytest.param(ExitCode.SAVED, "", id="ended in order"),
        pytest.param(ExitCode.FAILED, "earlier", id="failed"),
    ],
)
def test_the_results_stay_until_the_run_cannot_be_refused(tmp_path: Path, code: int, kept: str):
    (tmp_path / "summary.json").write_text(json.dumps({"exit_code": code}))
    (tmp_path / "trajectory.txt").write_text("of before")
    results = ReplacedResults(tmp_path)
    results.set_aside()
    replacement = Replacement(results)
    assert replacement.tick(may_be_refused=True) == ""
    assert results.exists and not replacement.has_begun
    names = [replacement.tick(may_be_refused=False)]
    deadline_s = time.monotonic() + 60
    while replacement.is_going_on and time.monotonic() < deadline_s:
        names.append(replacement.tick(may_be_refused=False))
    assert replacement.has_begun and not results.exists
    assert "".join(names) == kept
    assert replacement.tick(may_be_refused=False) == ""
    assert [path.name for path in tmp_path.iterdir()] == ([kept] if kept else [])
    if kept:
        assert (tmp_path / kept / "trajectory.txt").read_text() == "of before"
