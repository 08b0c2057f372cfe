"""What attempts have left goes, and no attempt that still lives takes a part of it for its result."""

import shutil
from pathlib import Path

import pytest

from hsslam_batch.attempt.commit import commit, settled
from hsslam_batch.attempt.serve_log import Terms, place_of
from hsslam_batch.cluster.work_folder import clear_work
from hsslam_batch.plan.log import read_manifest
from tests.batch.outcomes import outcome, planned, run_folder


def test_an_attempt_that_still_lives_finds_no_part_of_its_run_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    batch = planned(tmp_path / "out")
    run_dir = run_folder(batch, 0)
    (batch.work / ".removed.0123").mkdir()  # of a `run` that was killed while it removed
    remove = shutil.rmtree
    refused = []

    def commit_meanwhile(folder: Path, **options: bool) -> None:
        with pytest.raises(
            OSError, match=r"run: no summary\.json: expected a run folder"
        ) as raised:
            commit(batch, outcome(batch, 0), run_dir)
        refused.append(raised.value)
        remove(folder, **options)

    with monkeypatch.context() as while_it_is_removed:
        while_it_is_removed.setattr(shutil, "rmtree", commit_meanwhile)
        clear_work(batch)
    assert len(refused) == 1 and settled(batch, "id0") is None
    assert not batch.work.exists()
    clear_work(batch)  # there is nothing


def test_a_run_starts_with_the_downloaded_parts_and_leaves_none(tmp_path: Path):
    batch = planned(tmp_path / "out")
    run_folder(batch, 0)
    part = place_of(batch, read_manifest(batch.out)[1], Terms()).fetched / ".log1.partial"
    part.parent.mkdir()
    part.touch()
    clear_work(batch, but_fetched=True)
    assert list(batch.work.iterdir()) == [part.parent] and part.exists()
    clear_work(batch)
    assert not batch.work.exists()
