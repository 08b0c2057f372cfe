"""A log that is another one than when it was planned has no run under its old id."""

import dataclasses
import errno
import os
import tempfile
from pathlib import Path

import pytest

from hsslam_batch.attempt.local_log import expect_unchanged
from hsslam_batch.attempt.serve_log import Terms, serve_log
from hsslam_batch.plan.batch import UnavailableError
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_bench.batch.small_log import write_small_log
from hsslam_services.log.recovery import recover
from tests.services.serve_process import QUICK


@pytest.mark.parametrize("is_folder", [True, False], ids=["run folder", "file"])
def test_a_log_that_changed_after_the_plan_is_bad_input(tmp_path: Path, is_folder: bool):
    folder = tmp_path / "logs" / "a" if is_folder else tmp_path / "a"
    file = write_small_log(folder)
    if not is_folder:
        (tmp_path / "logs").mkdir()
        file = file.rename(tmp_path / "logs" / "a.mcap")
    plan_command([str(tmp_path / "logs"), "--out", str(tmp_path / "out"), *QUICK])
    batch = read_batch(str(tmp_path / "out"))
    (log,) = read_manifest(batch.out)
    assert log.frames == 6
    expect_unchanged(log, batch.out)
    os.utime(file, ns=(1, 1))
    outcome = serve_log(batch, log, Terms())
    assert outcome.kind == "bad input" and outcome.wall_s == 0
    assert f"{log.place}: has changed since the plan: expected the same files" in outcome.reason
    assert serve_log(batch, log, Terms(attempt=2)).reason == outcome.reason
    expect_unchanged(dataclasses.replace(log, frames=0), batch.out)  # its first reader completes it
    file.unlink()
    expect_unchanged(dataclasses.replace(log, place=str(file)), batch.out)


def test_a_log_without_an_end_may_have_been_completed_by_an_attempt(tmp_path: Path):
    file = write_small_log(tmp_path / "logs" / "a")
    file.write_bytes(file.read_bytes()[:-1000])  # its recorder was killed
    plan_command([str(tmp_path / "logs"), "--out", str(tmp_path / "out"), *QUICK])
    batch = read_batch(str(tmp_path / "out"))
    (log,) = read_manifest(batch.out)
    assert log.frames == 0
    recover(file)
    assert file.stat().st_size != log.nbytes
    expect_unchanged(log, batch.out)


@pytest.mark.parametrize("closed", ["logs/a", "logs"])
def test_a_log_that_this_user_may_not_read_fails_in_the_end(closed: str):
    """Another node may let it, so the other attempts are made."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_small_log(folder / "logs" / "a")
        plan_command([str(folder / "logs"), "--out", str(folder / "out"), *QUICK])
        batch = read_batch(str(folder / "out"))
        (log,) = read_manifest(batch.out)
        folder.chmod(0o755)
        batch.out.chmod(0o777)
        (folder / closed).chmod(0)
        own = os.geteuid()
        if own == 0:  # root may read everything
            os.seteuid(54321)
        try:
            outcomes = [serve_log(batch, log, Terms(attempt, 1)) for attempt in (1, 2)]
        finally:
            os.seteuid(own)
        (folder / closed).chmod(0o700)
    assert [(one.kind, one.is_left) for one in outcomes] == [("crash", True), ("crash", False)]
    assert outcomes[0].reason == f"{log.place}: Permission denied: expected a folder with logs"


def test_a_disk_that_cannot_be_read_says_nothing_about_the_log(tmp_path: Path, monkeypatch):
    write_small_log(tmp_path / "logs" / "a")
    plan_command([str(tmp_path / "logs"), "--out", str(tmp_path / "out"), *QUICK])
    batch = read_batch(str(tmp_path / "out"))
    (log,) = read_manifest(batch.out)

    def fail(*_, **__):
        raise OSError(errno.EIO, os.strerror(errno.EIO), log.place)

    for name in ("scandir", "stat"):
        with monkeypatch.context() as broken, pytest.raises(UnavailableError, match="Input/output"):
            broken.setattr(os, name, fail)
            expect_unchanged(log, batch.out)
