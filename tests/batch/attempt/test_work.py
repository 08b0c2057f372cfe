"""`hsslam-batch work` makes the run that a user makes by hand, and says why a log has none."""

import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_batch.attempt.commit import settled
from hsslam_batch.plan.batch import Batch, read_batch
from hsslam_batch.plan.command import plan_command
from hsslam_batch.plan.log import read_manifest
from tests.batch.small_logs import QUICK, write_small_log

pytestmark = pytest.mark.e2e
_LONG_S = 900  # on a machine that does other things


@pytest.fixture
def batch(tmp_path: Path) -> Batch:
    """A planned batch: a damaged log and a good one."""
    write_small_log(tmp_path / "logs" / "b-good")
    log = write_small_log(tmp_path / "logs" / "a-damaged")
    log.write_bytes(b"no log" + log.read_bytes())
    plan_command([str(tmp_path / "logs"), "--out", str(tmp_path / "out"), *QUICK])
    return read_batch(tmp_path / "out")


def _work(batch: Batch, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "hsslam_batch", "work", str(batch.out), *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=_LONG_S)


def test_a_log_becomes_the_run_that_a_user_makes(batch: Batch, tmp_path: Path):
    bad, good = read_manifest(batch.out)
    failed = _work(batch, "--index", str(bad.index))
    assert failed.returncode == 2
    assert "a-damaged: bad input: " in failed.stderr and "not an MCAP file" in failed.stderr
    outcome = settled(batch, bad.id)
    assert outcome and outcome.kind == "bad input" and "not an MCAP file" in outcome.reason

    done = _work(batch, "--index", str(good.index), "--memory", "6", "--timeout", "900")
    assert done.returncode == 0, done.stderr
    assert done.stdout == "b-good: done, 6 of 6 frames tracked\n"
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
    assert not list(batch.work.iterdir())
    arena = (batch.run_dir(good.id) / "run.json").read_text().partition('"arena_dir": "')[2]
    assert not Path(arena.partition('"')[0]).exists()

    again = _work(batch, "--index", str(good.index))
    assert again.returncode == 0 and "b-good: done" in again.stdout
    assert settled(batch, good.id) == outcome  # nothing ran
    beyond = _work(batch, "--index", "2")
    assert beyond.returncode == 2 and "--index 2: expected 0 to 1" in beyond.stderr
