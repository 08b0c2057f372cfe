"""`hsslam-batch work` makes the run that a user makes by hand, and says why a log has none."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hsslam_batch.__main__ import main
from hsslam_batch.attempt.commit import settled
from hsslam_batch.attempt.outcome import may_try_again
from hsslam_batch.attempt.store_results import StoredOutcome
from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.plan.read_batch import read_batch
from hsslam_bench.batch.small_log import write_small_log
from hsslam_node.errors import MORE_SHARED_MEMORY
from tests.batch.object_store import BUCKET, Faults, faulty, object_store, reach
from tests.in_process import run_main
from tests.services.run.installed_package import install
from tests.services.serve_process import QUICK
from tests.services.small_shared_memory import with_shared_memory

pytestmark = pytest.mark.e2e
_LONG_S = 900  # on a machine that does other things
_LAZY = """
from pathlib import Path
from hsslam_node.sources.source_row import SourceRow, has_suffix

ROW = SourceRow(
    kind="lazy",
    examples=("lazy:FILE",),
    brief="a stream without an index",
    about="a stream without an index",
    opener="hsslam_lazy:Lazy",
    looks_like=has_suffix(".lazy"),
)


class Lazy:
    def __init__(self, name, options):
        from hsslam_services.log.reading.source import McapSource

        self._log = McapSource(Path(name).read_text(), options)
        self.name, self.rate_hz, self.camera = name, self._log.rate_hz, self._log.camera
        self.depth_units_per_m = self._log.depth_units_per_m
        self.frame_count = None

    def frames(self, first=0):
        return self._log.frames(first)
"""


@pytest.fixture
def batch(tmp_path: Path) -> Batch:
    """A planned batch: a damaged log and a good one."""
    write_small_log(tmp_path / "logs" / "b-good")
    _write_damaged_log(tmp_path / "logs" / "a-damaged")
    plan_command([str(tmp_path / "logs"), "--out", str(tmp_path / "out"), *QUICK])
    return read_batch(str(tmp_path / "out"))


def _write_damaged_log(folder: Path) -> None:
    log = write_small_log(folder)
    log.write_bytes(b"no log" + log.read_bytes())


def _work(
    batch: Batch, *options: str, prefix: Sequence[str] = ()
) -> subprocess.CompletedProcess[str]:
    command = [*prefix, sys.executable, "-m", "hsslam_batch", "work", batch.place, *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=_LONG_S)


def _work_twice_at_once(batch: Batch, *options: str) -> list[subprocess.CompletedProcess[str]]:
    """As if a job array is submitted twice."""
    with ThreadPoolExecutor() as threads:
        return list(threads.map(lambda _: _work(batch, *options), range(2)))


def test_a_log_becomes_the_run_that_a_user_makes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A log that is damaged, and a good one, which a source of a plugin without a length reads."""
    install(tmp_path / "site", "hsslam-lazy", {"hsslam_lazy": _LAZY}, {"lazy": "hsslam_lazy:ROW"})
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"), prepend=os.pathsep)
    _write_damaged_log(tmp_path / "logs" / "a-damaged")
    log = write_small_log(tmp_path / "elsewhere")
    (tmp_path / "logs" / "b-good.lazy").write_text(str(log.parent))
    out = str(tmp_path / "out")
    plan = [sys.executable, "-m", "hsslam_batch", "plan", str(tmp_path / "logs"), "--out", out]
    said = subprocess.run([*plan, *QUICK], check=True, capture_output=True, text=True).stdout
    assert "2 of them: number of frames not known before the run" in said
    batch = read_batch(out)
    bad, good = read_manifest(batch.out)
    failed = _work(batch, "--index", str(bad.index))
    assert failed.returncode == 2
    assert "a-damaged: bad input: " in failed.stderr and "not an MCAP file" in failed.stderr
    outcome = settled(batch, bad.id)
    assert outcome and outcome.kind == "bad input" and "not an MCAP file" in outcome.reason

    limits = ("--memory", "6", "--timeout", "900")
    for done in _work_twice_at_once(batch, "--index", str(good.index), *limits):
        assert done.returncode == 0, done.stderr
        assert done.stdout == "b-good.lazy: done, 6 of 6 frames tracked\n"
    serve = [sys.executable, "-m", "hsslam_services.commands.serve", "--source", good.source]
    by_hand = [*serve, "--out", str(tmp_path / "hand"), "--pace", "lockstep", *QUICK]
    subprocess.run([*by_hand, "--viewer", "none"], check=True, capture_output=True, timeout=_LONG_S)
    for name in ("trajectory.txt", "trajectory_online.txt", "keyframes.txt"):
        made = (batch.run_dir(good.id) / name).read_bytes()
        assert made == (tmp_path / "hand" / name).read_bytes()

    outcome = settled(batch, good.id)
    assert outcome and outcome.is_done and outcome.frames == 6
    assert outcome.core_s > 0 and outcome.memory_mb > 0 and outcome.nbytes > 0
    assert batch.rrd_file(good.id).samefile(batch.run_dir(good.id) / "run.rrd")
    assert not [path for path in batch.work.iterdir() if path.is_dir()]
    arena = (batch.run_dir(good.id) / "run.json").read_text().partition('"arena_dir": "')[2]
    assert not Path(arena.partition('"')[0]).exists()

    again = run_main(main, "work", batch.place, "--index", str(good.index))
    assert again.returncode == 0 and "b-good.lazy: done" in again.stdout
    assert settled(batch, good.id) == outcome  # nothing ran
    beyond = run_main(main, "work", batch.place, "--index", "2")
    assert beyond.returncode == 2 and "--index 2: expected 0 to 1" in beyond.stderr


@pytest.mark.long
def test_a_batch_in_a_store_has_the_same_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_small_log(tmp_path / "logs" / "good")
    with object_store() as (server, client), faulty(server, Faults(5, of_all=True)) as address:
        reach(address, monkeypatch)
        batches = []
        for out in (str(tmp_path / "out"), f"s3://{BUCKET}/out"):
            plan_command([str(tmp_path / "logs"), "--out", out, *QUICK])
            batches.append(read_batch(out))
            done = _work(batches[-1], "--index", "0")
            assert (done.returncode, done.stdout) == (0, "good: done, 6 of 6 frames tracked\n")
        local, remote = batches
        try:
            again = _work(remote, "--index", "0")  # at once: it makes no run
            assert (again.returncode, again.stdout) == (done.returncode, done.stdout)
            (log,) = read_manifest(remote.out)
            row, here = settled(remote, log.id), settled(local, log.id)
            assert isinstance(row, StoredOutcome) and here
            assert (row.attempt, row.frames, row.mesh_faces) == (1, here.frames, here.mesh_faces)
            files = {p.relative_to(local.run_dir(log.id)).as_posix() for p in _files(local, log.id)}
            # the first run may have to compile kernels
            assert {*row.files} == files - {"_DONE.json", "logs/warm_up.log"}
            for name in ("trajectory.txt", "trajectory_online.txt", "keyframes.txt", "mesh.ply"):
                key = f"out/runs/{log.id}/{row.folder}/{name}"
                made = client.get_object(Bucket=BUCKET, Key=key)["Body"].read()
                assert made == (local.run_dir(log.id) / name).read_bytes()
            assert not [path for path in remote.work.iterdir() if path.is_dir()]
            bad = _work(remote, "--index", "7")
            assert (bad.returncode, bad.stderr) == (2, "error: --index 7: expected 0 to 0\n")
            with monkeypatch.context() as gone:
                reach("http://127.0.0.1:9", gone)
                # no bad input: a scheduler tries it again
                lost = _work(remote, "--index", "0", "--patience", "0")
            assert lost.returncode == 3 and "expected a store that can be read" in lost.stderr
        finally:
            shutil.rmtree(remote.out)


def _files(batch: Batch, log_id: str) -> Iterator[Path]:
    """All files of the result of a log."""
    return (path for path in batch.run_dir(log_id).rglob("*") if path.is_file())


def test_a_machine_without_a_kernel_cache_is_not_the_fault_of_the_log(batch: Batch, tmp_path: Path):
    """Another machine may run it: the log has no row, and the exit code is not that of bad input."""
    (tmp_path / "file").touch()
    command = [sys.executable, "-m", "hsslam_batch", "work", batch.place, "--index", "1"]
    done = subprocess.run(
        command,
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / "file")},
        capture_output=True,
        text=True,
        timeout=_LONG_S,
    )
    assert done.returncode == 3, done.stderr
    assert done.stderr.startswith("error: kernel cache ") and done.stderr.count("\n") == 1
    assert settled(batch, read_manifest(batch.out)[1].id) is None


def test_a_machine_without_a_cache_for_the_plan_is_not_the_fault_of_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "file").touch()
    write_small_log(tmp_path / "logs" / "good")
    with object_store() as (address, _):
        reach(address, monkeypatch)
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        plan_command([str(tmp_path / "logs"), "--out", f"s3://{BUCKET}/out"])
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
        done = subprocess.run(
            [sys.executable, "-m", "hsslam_batch", "work", f"s3://{BUCKET}/out", "--index", "0"],
            capture_output=True,
            text=True,
            timeout=_LONG_S,
        )
    assert done.returncode == 3, done.stderr
    assert "expected a cache that can be written" in done.stderr and done.stderr.count("\n") == 1


def test_a_machine_without_shared_memory_is_not_the_fault_of_the_log(batch: Batch):
    """It may be tried again, here once other runs have ended or elsewhere."""
    log = read_manifest(batch.out)[1]
    done = _work(batch, "--index", str(log.index), prefix=with_shared_memory("16k"))
    assert done.returncode == 3, done.stderr
    assert f"{log.name}: crash: " in done.stderr and MORE_SHARED_MEMORY in done.stderr
    row = settled(batch, log.id)
    assert row and row.kind == "crash" and may_try_again(row, retries=2)
