"""What killed attempts have left on a machine goes with the next attempt; living attempts keep theirs."""

import dataclasses
import errno
import fcntl
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import IO

import pytest

from hsslam_batch.attempt.claim import (
    LOCK,
    held_claim,
    held_claims,
    locked,
    remove_ended,
    write_claim,
)
from hsslam_batch.attempt.serve_log import Terms, place_of, serve_log
from hsslam_batch.attempt.watched_process import Limits
from hsslam_batch.plan import tried
from hsslam_batch.plan.log import read_manifest
from tests.batch.object_store import reach
from tests.batch.outcomes import planned

_NOBODY = 65534
_HOLD = """
import sys
from pathlib import Path
from hsslam_batch.attempt.claim import held_claim
with held_claim(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def _left(folder: Path, hours: float = 2.0) -> Path:
    """A folder of an attempt that was killed so long ago."""
    with held_claim(folder):
        (folder / "run").mkdir()
        (folder / "run" / "run.mcap").touch()
    _age(folder, hours)
    return folder


def _age(folder: Path, hours: float = 2.0) -> None:
    """Let all in a folder be so old."""
    past_s = time.time() - 3600 * hours
    for path in folder.rglob("*"):
        os.utime(path, (past_s, past_s))


def test_a_folder_goes_once_its_attempt_has_died(tmp_path: Path):
    folder = tmp_path / "id0.1.0123"
    command = [sys.executable, "-c", _HOLD, folder]
    attempt = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert attempt.stdout and attempt.stdout.readline() == b"held\n"
    _age(folder)
    remove_ended(tmp_path)
    assert folder.exists()
    attempt.kill()
    attempt.communicate()
    (folder / "run").touch()
    remove_ended(tmp_path)
    assert folder.exists()  # it has just changed
    _age(folder)
    remove_ended(tmp_path)
    assert not folder.exists()


def test_claims_hold_on_nfs_too(tmp_path: Path, monkeypatch):
    """Its locks are those of `fcntl`: a shared one needs a file to read, an exclusive one a file to write."""
    flock = fcntl.flock

    def of_nfs(file: int | IO, operation: int) -> None:
        access = fcntl.fcntl(file, fcntl.F_GETFL) & os.O_ACCMODE
        needed = os.O_RDONLY if operation & fcntl.LOCK_SH else os.O_WRONLY
        if access not in (needed, os.O_RDWR):
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        flock(file, operation)

    monkeypatch.setattr(fcntl, "flock", of_nfs)
    with held_claim(tmp_path / "a"):
        _age(tmp_path / "a")
        remove_ended(tmp_path)
        assert [folder for folder, _ in held_claims(tmp_path)] == [tmp_path / "a"]
    with locked(tmp_path), (tmp_path / LOCK).open("a+") as stream, pytest.raises(BlockingIOError):
        flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_folders_of_other_machines_and_of_no_attempt_stay(tmp_path: Path, monkeypatch):
    (tmp_path / "of-the-user").mkdir()
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(platform, "node", lambda: "another")
        _left(tmp_path / "id0.1.0123")
    remove_ended(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {LOCK, "of-the-user", "id0.1.0123"}


def test_an_attempt_removes_what_killed_ones_have_left_on_its_machine(tmp_path: Path, monkeypatch):
    """Those of other batches, too, if results go to a store: no `run` may come there that does it."""
    batch, scratch = planned(tmp_path / "cache" / "a"), tmp_path / "scratch"
    other = tmp_path / "cache" / "b" / batch.work.name
    left = [_left(parent / "id0.1.0123") for parent in (batch.work, other, scratch)]
    log = read_manifest(batch.out)[0]
    assert serve_log(batch, log, Terms(scratch=scratch)).kind == "crash"
    assert [folder.exists() for folder in left] == [False, True, False]
    reach("http://127.0.0.1:9", monkeypatch)
    monkeypatch.setattr(tried, "_FIRST_WAIT_S", 0.01)
    with pytest.raises(OSError, match="Could not connect"):
        serve_log(dataclasses.replace(batch, url="s3://fleet/a"), log, Terms())
    assert [path.name for path in other.iterdir()] == [LOCK]


def test_a_fetched_part_waits_a_day_for_the_next_run_and_its_own_attempt_never_removes_it(
    tmp_path: Path,
):
    batch, scratch = planned(tmp_path / "out"), tmp_path / "scratch"
    log = dataclasses.replace(read_manifest(batch.out)[0], place="s3://fleet/log0")
    terms = Terms(1, 2, Limits(timeout_s=1e-6), scratch)
    own = _left(place_of(batch, log, terms).fetched, hours=48)
    new, old = (_left(scratch / f"{name}.log", n) for name, n in (("new", 23), ("old", 25)))
    assert serve_log(batch, log, terms).kind == "timeout"
    assert [folder.exists() for folder in (own / "run", new, old)] == [True, True, False]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can act as another user")
def test_a_folder_that_users_share_shuts_none_of_them_out():
    with tempfile.TemporaryDirectory() as name:  # pytest's folders are closed to others
        parent = Path(name)
        parent.chmod(0o777)
        with held_claim(parent / "id0.1.0123") as claim_fd:
            write_claim(claim_fd, 7)
            os.seteuid(_NOBODY)
            try:
                assert list(held_claims(parent)) == [(parent / "id0.1.0123", 7)]
                with held_claim(parent / "id1.1.4567"):
                    assert len(list(held_claims(parent))) == 2
            finally:
                os.seteuid(0)
