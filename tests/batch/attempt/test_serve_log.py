"""What an attempt has fetched stays for the next one of its batch, or for none."""

import dataclasses
import itertools
import json
import os
import shutil
import sys
from pathlib import Path

import pytest

from hsslam_batch.attempt import watched_process
from hsslam_batch.attempt.commit import settled
from hsslam_batch.attempt.outcome import Kind
from hsslam_batch.attempt.serve_log import CancelledError, Terms, place_of, serve_log
from hsslam_batch.attempt.watched_process import Limits
from hsslam_batch.cluster.command import waiting_tries
from hsslam_batch.cluster.drive import Try
from hsslam_batch.options import RunOptions
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.find_logs import find_logs
from hsslam_batch.plan.listing import FileStamp, Listing
from hsslam_batch.plan.log import Log, read_manifest, write_manifest
from hsslam_batch.plan.remote_listing import list_url
from hsslam_batch.results.status import status_command
from tests.batch.object_store import BUCKET, Faults, faulty, object_store, reach
from tests.batch.outcomes import planned


def _in_store(out: Path) -> tuple[Batch, Log]:
    """A batch of a log that is elsewhere."""
    batch = planned(out, frames=(100,))
    (log,) = read_manifest(batch.out)
    there = dataclasses.replace(log, place="s3://fleet/log0")
    write_manifest(batch.out, [there])
    return batch, there


def _begin(batch: Batch, log: Log, terms: Terms) -> Path:
    """A folder with a part of the log, as an earlier attempt leaves it."""
    folder = place_of(batch, log, terms).fetched
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ".log0.partial").write_bytes(b"a part")
    return folder


def test_a_fetch_is_kept_for_an_attempt_that_may_follow(tmp_path: Path):
    batch, log = _in_store(tmp_path / "out")
    at_once = Limits(timeout_s=1e-6)
    for attempt, retries, is_kept in ((1, 2, True), (2, 2, False)):
        terms = Terms(attempt, retries, at_once, tmp_path / "scratch")
        folder = _begin(batch, log, terms)
        assert serve_log(batch, log, terms).kind == "timeout"
        assert folder.exists() == is_kept
    readable, writable = os.pipe()
    os.close(writable)  # as of a worker that died
    for attempt, retries, is_kept in ((1, 2, True), (3, 2, False), (1, 0, False)):
        terms = Terms(attempt, retries, Limits(), tmp_path / "scratch")
        folder = _begin(batch, log, terms)
        with pytest.raises(CancelledError):
            serve_log(batch, log, terms, cancel_fds=[readable])
        assert folder.exists() == is_kept
    os.close(readable)


def test_bad_input_leaves_nothing_and_no_batch_takes_the_fetch_of_another(tmp_path: Path):
    scratch = tmp_path / "scratch"
    batch, log = _in_store(tmp_path / "a")
    other, same_log = _in_store(tmp_path / "b")
    assert log == same_log
    terms = Terms(1, 2, Limits(), scratch, fetch_gb=1e-9)
    folder, of_other = _begin(batch, log, terms), _begin(other, log, terms)
    outcome = serve_log(batch, log, terms)
    assert outcome.kind == "bad input" and "(--fetch-gb)" in outcome.reason
    assert [path for path in scratch.iterdir() if path.is_dir()] == [of_other] != [folder]


def test_a_log_that_a_store_does_not_give_has_not_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """No attempt at it is left, but the next `run` takes it again."""
    batch, log = _in_store(tmp_path / "out")
    reach("http://127.0.0.1:9", monkeypatch)
    outcome = serve_log(batch, log, Terms(1, 0, Limits(), tmp_path / "scratch"))
    assert outcome.kind == "unavailable"
    assert outcome.reason.startswith("exit code 1 (the log could not be fetched); ")
    assert " s3://fleet/log0: Could not connect" in outcome.reason
    assert settled(batch, log.id) == outcome and outcome.started_ns > 0
    assert status_command([str(batch.out)]) == 1
    assert "0 failed, 1 left" in capsys.readouterr().out
    assert waiting_tries({0: outcome}, RunOptions()) == [Try(0)]


def test_a_disk_without_room_is_not_the_fault_of_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    batch, log = _in_store(tmp_path / "out")
    terms = Terms(1, 0, Limits(), tmp_path / "scratch")
    folder = _begin(batch, log, terms)
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=10))
    outcome = serve_log(batch, log, terms)
    assert (outcome.kind, outcome.exit_code) == ("unavailable", 1) and not folder.exists()
    said = f"{tmp_path / 'scratch'}: 0.0 MB free, 0.0 MB needed: expected a folder with room (--scratch)"
    assert outcome.reason == said


def test_a_log_that_is_larger_than_the_disk_fails_in_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Another node may have a larger disk, so the other attempts are made."""
    batch, log = _in_store(tmp_path / "out")
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=10, total=500))
    for attempt, is_left in ((1, True), (2, False)):
        outcome = serve_log(batch, log, Terms(attempt, 1, Limits(), tmp_path / "scratch"))
        assert (outcome.kind, outcome.is_left) == ("crash", is_left)
        said = "scratch: a disk of 0.0 MB, 0.0 MB needed: expected a folder with room (--scratch)"
        assert outcome.reason.endswith(said)


@pytest.mark.parametrize("closed", ["", "/fleet/logs/a.mcap", "/"])
def test_a_log_that_nobody_may_read_fails_in_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, closed: str
):
    """An archived object, and an object of another user. If all is refused, the log is not at fault."""
    with object_store() as (server, client), faulty(server, Faults(1000, closed=closed)) as address:
        reach(server, monkeypatch)
        archive = {} if closed else {"StorageClass": "GLACIER"}
        client.put_object(Bucket=BUCKET, Key="logs/a.mcap", Body=b"a log", **archive)
        batch = planned(tmp_path / "out", frames=(100,))
        write_manifest(batch.out, find_logs(list_url(f"s3://{BUCKET}/logs")))
        (log,) = read_manifest(batch.out)
        reach(address, monkeypatch)
        outcome = serve_log(batch, log, Terms(2, 1, Limits(), tmp_path / "scratch"))
    if closed == "/":
        assert outcome.kind == "unavailable"
        assert "OSError: s3://fleet/logs: Forbidden" in outcome.reason
        return
    assert (outcome.kind, outcome.is_left) == ("crash", False), outcome.reason
    begin = "exit code 3 (the store does not give the log); s3://fleet/logs/a.mcap: "
    assert outcome.reason.startswith(begin)
    assert outcome.reason.endswith(": expected a log that this user may read")


def test_files_beside_a_log_want_room_on_the_disk_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A sequence of 30 bytes with a mesh of 1 MB, and a disk on which only the sequence fits."""
    batch = planned(tmp_path / "out", frames=(100,))
    sizes = {
        "room0/traj.txt": 10,
        "room0/results/frame000000.jpg": 20,
        "cam_params.json": 10,
        "room0_mesh.ply": 1_000_000,
        "room1_mesh.ply": 1_000_000,
    }
    files = {name: FileStamp(nbytes, "1") for name, nbytes in sizes.items()}
    found = find_logs(Listing(f"s3://{BUCKET}/archive", files))
    write_manifest(batch.out, found)
    (log,) = read_manifest(batch.out)
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=900_000))
    outcome = serve_log(batch, log, Terms(1, 0, Limits(), tmp_path / "scratch"))
    said = "0.9 MB free, 1.0 MB needed: expected a folder with room (--scratch)"
    assert outcome.kind == "unavailable" and outcome.reason.endswith(said), outcome.reason


def _python(folder: Path, script: str) -> str:
    """A script in the place of Python."""
    path = folder / "python"
    path.write_text(f"#!/bin/bash\n{script}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(("counted", "kind"), [(20, "done"), (21, "crash"), (None, "bad input")])
def test_the_camera_of_the_run_has_counted_the_frames_of_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counted: int | None, kind: Kind
):
    """Nothing opens the log again, which would be an error here: it is no log by now."""
    batch = planned(tmp_path / "out", frames=(0,))
    (log,) = read_manifest(batch.out)
    log = dataclasses.replace(log, place=str(tmp_path / "log.mcap"))
    Path(log.place).write_bytes(b"no log")
    counters = {} if counted is None else {"source_frames": counted}
    camera = {"processes": {"camera": {"counters": counters}}}
    summary = tmp_path / "summary.json"
    summary.write_text(json.dumps({"frames": {"in": 20, "tracked": 20, "lost": 0}} | camera))
    script = f'mkdir "${{@: -1}}" && exec cp {summary} "${{@: -1}}"'  # --out is the last option
    monkeypatch.setattr(sys, "executable", _python(tmp_path, script))
    outcome = serve_log(batch, log, Terms())
    assert (outcome.kind, outcome.frames) == (kind, 20), outcome.reason


def test_a_fetch_that_the_kernel_kills_is_lack_of_memory(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(sys, "executable", _python(tmp_path, "kill -9 $$"))
    monkeypatch.setattr(watched_process, "oom_kills", itertools.count().__next__)  # of the kernel
    batch, log = _in_store(tmp_path / "out")
    outcome = serve_log(batch, log, Terms())
    assert outcome.kind == "out of memory" and "killed by SIGKILL" in outcome.reason


@pytest.mark.alone
def test_a_run_has_the_time_that_the_fetch_leaves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A script in the place of Python: the fetch takes 0.8 s, the run would take a minute."""
    slow = 'case "$*" in *attempt.fetch*) exec sleep 0.8;; esac\nexec sleep 60'
    monkeypatch.setattr(sys, "executable", _python(tmp_path, slow))
    batch, log = _in_store(tmp_path / "out")
    outcome = serve_log(batch, log, Terms(limits=Limits(timeout_s=1.7)))
    assert outcome.reason == "stopped: took longer than 1.7 s (--timeout)"
    assert outcome.fetch_s > 0.8 and outcome.wall_s < 1.7
