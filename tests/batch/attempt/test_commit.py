"""A result counts from one step on, of one configuration, and once."""

import shutil
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path

import pytest
import rerun as rr

from hsslam_batch.attempt import commit as commit_module
from hsslam_batch.attempt.commit import (
    all_settled,
    commit,
    settle_failed,
    settle_files,
    settled,
)
from hsslam_batch.plan.batch import Batch, UnavailableError
from hsslam_batch.plan.log import read_manifest
from tests.batch.outcomes import outcome, planned, run_folder
from tests.services.recorded import RERUN


def test_a_run_counts_once_it_has_its_row(tmp_path: Path):
    batch = planned(tmp_path / "out")
    good = outcome(batch, 0, tracked=99)
    assert settled(batch, "id0") is None
    commit(batch, good, run_folder(batch, 0))
    assert settled(batch, "id0") == good
    assert (batch.run_dir("id0") / "trajectory.txt").read_text() == "a pose"
    assert _recordings(batch) == ["rrd.1/id0.rrd", "rrd/id0.rrd"]
    batch.done_file("id0").unlink()  # as if the power had failed just before
    assert settled(batch, "id0") is None
    again = outcome(batch, 0, attempt=2)
    commit(batch, again, _second_run_folder(batch))
    assert settled(batch, "id0") == again
    assert batch.rrd_file("id0").read_text() == "second"


def test_the_first_of_two_attempts_stays(tmp_path: Path):
    batch = planned(tmp_path / "out")
    first = outcome(batch, 0, node="a")
    commit(batch, first, run_folder(batch, 0))
    commit(batch, outcome(batch, 0, node="b"), _second_run_folder(batch))
    settle_failed(batch, outcome(batch, 0, "lost", node="c"))
    assert settled(batch, "id0") == first
    assert (batch.run_dir("id0") / "trajectory.txt").read_text() == "a pose"
    assert not batch.failed_file("id0").exists()


def test_two_attempts_that_end_together_leave_the_row_and_the_files_of_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    batch = planned(tmp_path / "out")
    first = outcome(batch, 0, node="a")
    folder = run_folder(batch, 0)
    folder = folder.rename(folder.with_name("first"))
    second = outcome(batch, 0, node="b"), run_folder(batch, 0, "second")
    other = threading.Thread(target=commit, args=(batch, *second))
    link = commit_module._link_recordings

    def linked_while_the_other_commits(batch: Batch, log_id: str) -> None:
        if other.ident is None:
            other.start()
            other.join(0.5)
        link(batch, log_id)

    monkeypatch.setattr(commit_module, "_link_recordings", linked_while_the_other_commits)
    commit(batch, first, folder)
    other.join()
    assert settled(batch, "id0") == first
    assert (batch.run_dir("id0") / "trajectory.txt").read_text() == "a pose"


def test_a_failure_is_kept_until_the_log_is_done(tmp_path: Path):
    batch = planned(tmp_path / "out")
    failure = outcome(batch, 1, "crash", reason="killed by SIGKILL")
    settle_failed(batch, failure)
    assert settled(batch, "id1") == failure
    commit(batch, outcome(batch, 1, attempt=2), run_folder(batch, 1))
    found = settled(batch, "id1")
    assert found and found.is_done and not batch.failed_file("id1").exists()


def test_results_of_another_configuration_do_not_count(tmp_path: Path):
    batch = planned(tmp_path / "out")
    commit(batch, outcome(batch, 0), run_folder(batch, 0))
    settle_failed(batch, outcome(batch, 1, "crash"))
    other = planned(tmp_path / "out", seed=1)
    assert other.about != batch.about
    assert settled(other, "id0") is settled(other, "id1") is None


def test_a_failure_under_another_configuration_leaves_the_results_of_the_first(tmp_path: Path):
    batch = planned(tmp_path / "out")
    good = outcome(batch, 0)
    commit(batch, good, run_folder(batch, 0))
    other = planned(tmp_path / "out", seed=1)
    failure = outcome(other, 0, "bad input")
    settle_failed(other, failure)
    assert settled(other, "id0") == failure
    settle_files(other, read_manifest(other.out))
    assert _recordings(other) == []  # its own
    again = planned(tmp_path / "out")
    assert settled(again, "id0") == good
    settle_files(again, read_manifest(again.out))
    assert _recordings(again) == ["rrd.1/id0.rrd", "rrd/id0.rrd"]
    third = planned(tmp_path / "out", seed=2)
    commit(third, outcome(third, 0), _second_run_folder(third))
    assert settled(batch, "id0") is None
    assert (third.run_dir("id0") / "trajectory.txt").read_text() == "second"


@pytest.mark.parametrize("is_removed_whole", [True, False])
def test_a_run_folder_that_was_removed_replaces_no_result(tmp_path: Path, is_removed_whole: bool):
    batch = planned(tmp_path / "out")
    good = outcome(batch, 0)
    commit(batch, good, run_folder(batch, 0))
    other = planned(tmp_path / "out", seed=1)
    run_dir = _second_run_folder(other)
    (run_dir / "summary.json").unlink()
    if is_removed_whole:
        shutil.rmtree(run_dir)
    with pytest.raises(OSError, match=r"run: no summary\.json: expected a run folder"):
        commit(other, outcome(other, 0), run_dir)
    assert settled(other, "id0") is None and settled(batch, "id0") == good
    assert (batch.run_dir("id0") / "trajectory.txt").read_text() == "a pose"


def test_recordings_are_those_of_logs_that_are_done(tmp_path: Path):
    batch = planned(tmp_path / "out")
    for index in range(3):
        commit(batch, outcome(batch, index), run_folder(batch, index))
    batch.done_file("id1").unlink()
    fewer = planned(tmp_path / "out", frames=(100, 200))
    settle_files(fewer, read_manifest(fewer.out))
    assert _recordings(fewer) == ["rrd.1/id0.rrd", "rrd/id0.rrd"]
    again = planned(tmp_path / "out")
    settle_files(again, read_manifest(again.out))
    assert _recordings(again) == [f"{part}/id{k}.rrd" for part in ("rrd.1", "rrd") for k in (0, 2)]
    assert again.rrd_file("id2").samefile(again.run_dir("id2") / "run.rrd")


def test_rerun_serves_each_log_and_each_part_of_it(tmp_path: Path):
    """All parts have the recording id of the run, and rerun takes one file of an id into a data set."""
    batch = planned(tmp_path / "out", frames=(100, 200))
    for index, parts in enumerate((("run", "run.1", "run.2", "run.10"), ("run", "run.1"))):
        folder = run_folder(batch, index)
        _draw([folder / f"{part}.rrd" for part in parts], f"run-{index}")
        commit(batch, outcome(batch, index), folder)
    sets = sorted(batch.out.glob("rrd*"))
    assert [path.name for path in sets] == ["rrd", "rrd.1", "rrd.2", "rrd.3"]
    assert batch.rrd_file("id0", 3).samefile(batch.run_dir("id0") / "run.10.rrd")
    command = [RERUN, "server", "--host", "127.0.0.1", "--port", "0"]
    command += [word for path in sets for word in ("--dataset", str(path))]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server:
        assert server.stderr
        said = []
        for line in server.stderr:
            said.append(line)
            if "Ready for connections" in line:
                break
        server.terminate()
    assert sum("Loading " in line for line in said) == 6
    assert sum("Finished loading" in line for line in said) == len(sets), said
    assert not any("Failed" in line for line in said), said


def _draw(files: Sequence[Path], recording_id: str) -> None:
    """Write the parts of a recording, as a run does."""
    stream = rr.RecordingStream("hsslam", recording_id=recording_id)
    for k, file in enumerate(files):
        stream.set_sinks(rr.FileSink(file))
        stream.set_time("frame", sequence=k)
        stream.log("/x", rr.Scalars(float(k)))
    stream.disconnect()


def _recordings(batch: Batch) -> list[str]:
    """The files in the folders of recordings."""
    return sorted(str(path.relative_to(batch.out)) for path in batch.out.glob("rrd*/*"))


def _second_run_folder(batch: Batch) -> Path:
    """The run folder of a second attempt at log 0."""
    (batch.work / "id0.1").rename(batch.work / "away")
    return run_folder(batch, 0, "second")


def test_a_row_that_cannot_be_read_is_not_a_log_that_is_left(tmp_path: Path):
    batch = planned(tmp_path / "out", frames=(100,))
    commit(batch, outcome(batch, 0), run_folder(batch, 0))
    row = batch.done_file("id0")
    row.unlink()
    row.mkdir()  # reading it is an error, as of a broken file system
    with pytest.raises(UnavailableError, match="out: Is a directory"):
        all_settled(batch, read_manifest(batch.out))
