"""Results that are not saved stay in memory until a rescue; a killed supervisor costs none of them."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import psutil
import pytest

from hsslam_node.geometry.trajectory import read_tum
from hsslam_services.arena.arena_folder import SHM_ROOT
from hsslam_services.arena.unsaved_marker import ARENA_ARTEFACTS, mark_unsaved
from hsslam_services.run.exit_code import ExitCode
from hsslam_services.run.run_info import RunInfo
from tests.services.serve_process import SMALL_ROOM, ServeProcess

pytestmark = pytest.mark.e2e
_LONG = ("--synth.length", "1500")
_RESULTS = ("trajectory.txt", "trajectory_online.txt", "map.safetensors", "mesh.ply")


def _rescue(place: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "hsslam_services.commands.serve", "rescue", str(place)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def _missing(folder: Path) -> list[str]:
    return [name for name in _RESULTS if not (folder / name).is_file()]


def _arena(run: ServeProcess) -> Path:
    return Path(json.loads((run.out / "run.json").read_text())["arena_dir"])


def _refuse_more_of_the_log(run: ServeProcess) -> None:
    """As a full disk does, for the recorder alone."""
    nbytes, pid = (run.out / "run.mcap").stat().st_size, run.pid_of("recorder")
    assert pid is not None
    psutil.Process(pid).rlimit(psutil.RLIMIT_FSIZE, (nbytes, nbytes))


def test_what_cannot_be_written_is_kept_and_rescued(serve):
    run = serve(*SMALL_ROOM, *_LONG)
    run.wait_for_poses(20)
    _refuse_more_of_the_log(run)
    in_the_way = run.out / "trajectory.txt"
    in_the_way.mkdir()
    arena = _arena(run)
    running = _rescue(run.out)
    assert running.returncode == ExitCode.BAD_INPUT and "in use by its run" in running.stderr
    run.signal()
    assert run.finish() == ExitCode.NOT_SAVED, run.stderr
    assert _missing(run.out) == ["trajectory.txt"]
    why = "the disk was full or could not be written, and some messages are lost"
    of_log = f"log not saved: {why}; run hsslam-log recover {run.out}"
    assert of_log in run.stderr
    last = run.stderr.strip().splitlines()[-1]
    assert last.endswith(f"hsslam-serve rescue {arena}")  # the run folder may go, this stays
    summary = run.summary()
    assert list(summary["not_saved"]) == ["trajectories", "log"] and summary["exit_code"] == 4
    steps = list(summary["end_s"])  # in order; without what is not saved
    assert steps[:3] == ["camera", "tracker", "map"] and "trajectories" not in steps
    assert summary["end_s"]["camera"] > 0 and max(summary["end_s"].values()) < 120
    _expect_rescue_beside_another_run(run, arena)
    in_the_way.rmdir()
    replaced = run.out / ".replaced"
    replaced.mkdir()
    (replaced / "map.safetensors").write_text("of the run before")
    done = _rescue(run.out)
    assert done.returncode == ExitCode.NOT_SAVED and of_log in done.stderr
    assert f"{run.out}: the results of the previous run are in earlier\n" in done.stderr
    assert (run.out / "earlier" / "map.safetensors").read_text() == "of the run before"
    assert (run.out / "trajectory.txt").stat().st_mode & 0o077 == 0
    assert len(read_tum(run.out / "trajectory.txt")) >= 20
    assert list(run.summary()["not_saved"]) == ["log"]
    run.expect_nothing_left()
    again = _rescue(run.out)  # without its memory
    assert again.returncode == ExitCode.NOT_SAVED and of_log in again.stderr


def _expect_rescue_beside_another_run(run: ServeProcess, arena: Path) -> None:
    """A rescue by the arena, while another run has the folder."""
    own = (run.out / "run.json").read_text()
    run_id = json.loads(own)["run_id"]
    (run.out / "run.json").write_text(own.replace(run_id, "another"))
    files = {path: path.stat().st_mtime_ns for path in run.out.iterdir()}
    beside = run.out.with_name(f"{run.out.name}-rescued-{run_id}")
    (beside / "trajectory.txt").mkdir(parents=True)  # so that memory stays
    done = _rescue(arena)
    assert done.returncode == ExitCode.NOT_SAVED and "Is a directory" in done.stderr
    assert f"{run.out}: holds another run now: saving to {beside}\n" in done.stderr
    assert {path: path.stat().st_mtime_ns for path in run.out.iterdir()} == files
    (run.out / "run.json").write_text(own)


def test_a_killed_run_is_rescued_before_the_next_one_in_its_folder_begins(serve, tmp_path: Path):
    first = serve(*SMALL_ROOM, *_LONG)
    first.wait_for_poses(20)
    psutil.Process(first.process.pid).suspend()  # it would start the watchdog again
    watchdog = first.pid_of("watchdog")
    assert watchdog is not None
    psutil.Process(watchdog).kill()
    arena = RunInfo.read(first.out).arena_dir
    first.out.rename(tmp_path / "unplugged")
    first.kill_supervisor()
    # as a watchdog leaves it that is killed while it saves
    mark_unsaved(Path(arena), first.out, ARENA_ARTEFACTS, is_being_saved=True)
    second = serve(*SMALL_ROOM, "--frames", "10", "--out", str(first.out))
    second.out = first.out
    assert second.finish() == ExitCode.SAVED, second.stderr
    (aside,) = first.out.glob("earlier-*")
    assert "results are being saved" in second.stderr and aside.name in second.stderr
    assert _missing(aside) == [] == _missing(second.out)
    assert len(read_tum(aside / "trajectory.txt")) >= 20
    assert second.summary()["frames"]["in"] == 10
    assert all(process["restarts"] == 0 for process in second.summary()["processes"].values())
    second.expect_nothing_left()


def test_a_rescue_that_is_interrupted_has_not_saved_everything(tmp_path: Path):
    os.mkfifo(tmp_path / "run.json")
    command = [sys.executable, "-m", "hsslam_services.commands.serve", "rescue", str(tmp_path)]
    # a job in the background ignores the signal
    hears = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with (
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=hears) as process,
        (tmp_path / "run.json").open("wb"),  # it is at work, and waits there
    ):
        while process.poll() is None:  # a signal just before it waits is seen only after
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=2)
        assert process.stderr is not None
        told = process.stderr.read()
    assert process.returncode == ExitCode.NOT_SAVED
    assert told == "rescue interrupted: unsaved results stay in memory\n"


def test_an_arena_that_is_gone_is_one_line():
    gone = SHM_ROOT / "hsslam-gone"
    done = _rescue(gone)
    assert done.returncode == ExitCode.BAD_INPUT
    assert done.stderr.startswith(f"error: {gone}: does not exist: expected the run folder")
