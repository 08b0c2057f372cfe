"""The metrics of a batch follow its counts, in a file that node_exporter can read at any moment."""

import ctypes
import os
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from hsslam_batch.options import RunOptions
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.results.metrics import MetricsFile
from hsslam_batch.results.progress import BatchProgress
from hsslam_batch.results.tally import Tally
from hsslam_node.errors import UserError
from tests.batch.outcomes import outcome, planned


def _read(path: Path) -> dict[str, float]:
    """All samples, those of states by name and state."""
    return {
        sample.name + sample.labels.get("state", ""): sample.value
        for family in text_string_to_metric_families(path.read_text())
        for sample in family.samples
    }


def _names_made(folder: Path, write: Callable[[], object]) -> set[str]:
    """The names that appear in a folder during a write, temporary ones too."""
    libc, head = ctypes.CDLL(None), struct.Struct("iIII")
    inotify = libc.inotify_init()
    assert (
        libc.inotify_add_watch(inotify, os.fsencode(folder), 0x180) >= 0
    )  # IN_CREATE, IN_MOVED_TO
    write()
    said, names = os.read(inotify, 1 << 16), set()
    os.close(inotify)
    while said:
        *_, length = head.unpack_from(said)
        names.add(said[head.size : head.size + length].rstrip(b"\0").decode())
        said = said[head.size + length :]
    return names


def test_the_collector_never_finds_half_a_file_or_a_second_one(tmp_path: Path):
    """node_exporter reads all names that end in .prom, hidden ones too."""
    batch = planned(tmp_path / "out", frames=(100,))
    folder = tmp_path / "collected"
    folder.mkdir()
    metrics = MetricsFile(folder / "batch.prom", batch.about)
    tally = Tally(read_manifest(batch.out), [])
    names = _names_made(folder, lambda: metrics.write(tally, running=0))
    assert len(names) == 2 and [n for n in names if n.endswith(".prom")] == ["batch.prom"]


def test_metrics_follow_the_counts(tmp_path: Path):
    batch = planned(tmp_path / "out", frames=(100, 200, 300))
    file = tmp_path / "batch.prom"
    tally = Tally(read_manifest(batch.out), [outcome(batch, 0, core_s=50.0)])
    with BatchProgress(batch, tally, file) as progress:
        begun = _read(file)
        progress.tried_again(outcome(batch, 1, "crash"))
        progress.settled(outcome(batch, 1, frames=200, core_s=7.5))
    ended = _read(file)
    states = {s: ended[f"hsslam_batch_logs{s}"] for s in ("done", "failed", "left")}
    assert states == {"done": 2, "failed": 0, "left": 1} and begun["hsslam_batch_logsleft"] == 2
    assert "hsslam_batch_rest_seconds" not in begun and "hsslam_batch_rest_seconds" in ended
    assert (ended["hsslam_batch_frames"], ended["hsslam_batch_frames_done"]) == (600, 300)
    assert ended["hsslam_batch_attempts_repeated_total"] == 1
    assert ended["hsslam_batch_core_seconds_total"] == 7.5  # not what earlier commands took
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["batch.prom"]


def test_no_log_ends_for_files_of_progress_that_cannot_be_written(tmp_path: Path, capfd):
    """The folder of the collector goes away, the store of the batch is closed to us."""
    store = f"memory://{tmp_path.name}/batch"
    batch = planned(tmp_path / "out", frames=(100, 200), url=store)
    file = tmp_path / "collected" / "batch.prom"
    file.parent.mkdir()
    tally = Tally(read_manifest(batch.out), [])
    with BatchProgress(batch, tally, file) as progress:
        file.unlink()
        file.parent.rmdir()
        (batch.out / "progress.jsonl").unlink()  # reading it for the store fails
        for index in range(2):
            progress.settled(outcome(batch, index))
    said = capfd.readouterr().err
    assert said.count(f"warning: {file}: No such file or directory: not written") == 1
    assert said.count("warning: progress.jsonl: No such file or directory: not written") == 1
    assert (tally.done, tally.left) == (2, 0)


def test_a_folder_of_metrics_that_is_not_there_is_refused_before_the_start(tmp_path: Path):
    with pytest.raises(UserError, match=r"^--metrics-file .*: no such folder: expected a file in"):
        RunOptions(metrics_file=tmp_path / "none" / "batch.prom")


def test_a_file_that_the_collector_would_not_read_is_refused():
    with pytest.raises(UserError, match=r"^--metrics-file batch.txt: expected a name that ends in"):
        RunOptions(metrics_file=Path("batch.txt"))
