"""A run folder: what a run reads is never removed from it, and it has one run at a time."""

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest

from hsslam_node.errors import UserError
from hsslam_node.map.pose_log import POSE_ROW, PoseLog
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.arena_folder import SHM_ROOT, ArenaFolder, run_dir_of
from hsslam_services.arena.unsaved_marker import is_marked, mark_unsaved, read_unsaved
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.run.run_info import RunInfo
from hsslam_services.supervisor import earlier_run
from hsslam_services.supervisor.earlier_run import wait_for_earlier_run
from hsslam_services.supervisor.folder_claim import FolderClaim
from hsslam_services.supervisor.preparation import Prepared, prepare
from tests.services.serve_process import SMALL_ROOM
from tests.services.small_shared_memory import with_tmpfs


@pytest.fixture
def earlier(tmp_path: Path) -> dict[Path, bytes]:
    """The files of a run that ended, and a picture of the user's."""
    folder = tmp_path / "site"
    folder.mkdir()
    names = ("run.json", "map.safetensors", "mesh.ply", "trajectory.txt")
    files = {folder / name: name.encode() for name in names}
    files[folder / "summary.json"] = b'{"exit_code": 0}'
    files[folder / "mask.png"] = cv2.imencode(".png", np.full((120, 160), 255, np.uint8))[
        1
    ].tobytes()
    for path, content in files.items():
        path.write_bytes(content)
    return files


@pytest.mark.parametrize(
    ("option", "name", "what"),
    [
        ("--map", "map.safetensors", "the map of --map"),
        ("--mask", "mask.png", "the image of --mask"),
    ],
)
def test_what_the_run_reads_is_not_removed(serve, earlier, option: str, name: str, what: str):
    folder = next(iter(earlier)).parent
    run = serve(*SMALL_ROOM, option, str(folder / name), "--out", str(folder))
    assert run.finish(60) == 2
    assert run.stderr == f"error: --out {folder}: holds {what}: expected another folder\n"
    assert {path: path.read_bytes() for path in earlier} == earlier


def test_a_watchdog_that_cannot_be_started_leaves_all_as_it_was(serve, earlier):
    folder = next(iter(earlier)).parent
    (folder / "logs").mkdir()
    read_only = with_tmpfs("ro", folder / "logs")
    run = serve(*SMALL_ROOM, "--out", str(folder), prefix=read_only)
    assert run.finish(60) == 2
    said = "the watchdog cannot be started: Read-only file system"
    assert run.stderr == f"error: {folder}: {said}\n"
    for arena in SHM_ROOT.glob("hsslam-*"):
        with contextlib.suppress(OSError):  # of another test, which removes it
            assert run_dir_of(arena) != folder
    assert not [p.pid for p in psutil.process_iter() if str(folder) in _command(p)]
    assert {path: path.read_bytes() for path in earlier} == earlier


def _command(process: psutil.Process) -> list[str]:
    with contextlib.suppress(psutil.Error):
        return process.cmdline()
    return []


def test_a_run_that_is_refused_leaves_the_results_of_one_that_failed(earlier: dict[Path, bytes]):
    folder = next(iter(earlier)).parent
    earlier[folder / "summary.json"] = b'{"exit_code": 3}'
    (folder / "summary.json").write_bytes(earlier[folder / "summary.json"])
    run = _prepared("--out", str(folder))
    run.close()
    run.arena.remove()
    run.give_back()
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == earlier


@pytest.mark.parametrize("home", ["", "~"])
def test_a_map_in_the_maps_folder_is_found_by_its_name(earlier, monkeypatch, home: str):
    folder = next(iter(earlier)).parent
    if home:
        monkeypatch.setenv("HOME", str(folder.parent))
        folder = Path("~") / folder.name
    with pytest.raises(UserError, match="holds the map of --map: expected another folder"):
        _prepared("--map", "map", "--maps", str(folder), "--out", str(folder))
    with pytest.raises(UserError, match=r"--map mop: no such map in .*did you mean map"):
        _prepared("--map", "mop", "--maps", str(folder))


def _prepared(*options: str) -> Prepared:
    return prepare(parse_command_line(["--source", "synth:room", *options]), lambda: False)


@pytest.mark.parametrize("option", ["--out", "--config"])
def test_a_name_that_run_json_cannot_hold_is_refused(tmp_path: Path, option: str):
    path = tmp_path / "b\udcff"
    place = path if option == "--out" else path.with_suffix(".toml")
    if option == "--config":
        place.write_text("seed = 1\n")
    with pytest.raises(UserError, match=r"'.*b\\udcff.*: is not UTF-8: expected"):
        _prepared(option, str(place), *(["--out", str(tmp_path / "run")] * (option != "--out")))


def test_two_runs_at_once_have_two_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(time, "strftime", lambda _: "20260101-000000")  # in the same second
    runs = []
    try:
        for _ in range(3):
            runs.append(_prepared())
        names = [run.info.path.name for run in runs]
        first = "synth-room-20260101-000000"
        assert names == [first, f"{first}-2", f"{first}-3"]
        with pytest.raises(UserError, match=rf"--out .*{first}: in use by another run: expected"):
            _prepared("--out", f"runs/{first}")
        assert (tmp_path / "runs" / first / "run.json").exists()
    finally:
        for run in runs:
            run.close()
            run.arena.remove()


def test_poses_of_a_dead_run_whose_folder_cannot_be_made_are_kept(tmp_path: Path):
    (tmp_path / "unplugged").touch()
    dead = ArenaFolder(f"test-{os.getpid()}", tmp_path / "unplugged" / "run")
    PoseLog(Arena(dead.path)).append(np.zeros((), POSE_ROW))
    dead.let_go()
    run = _prepared("--out", str(tmp_path / "next"))
    try:
        rescue = f"hsslam-serve rescue {dead.path}"
        assert any(text.endswith(rescue) for text, _ in run.notices)
        assert is_marked(dead.path)
    finally:
        run.close()
        run.arena.remove()
        dead.remove()


def test_results_whose_watchdogs_die_are_left_to_the_user(
    make_run: Callable[..., RunInfo], monkeypatch: pytest.MonkeyPatch
):
    """The run before was killed, and each watchdog too, as without memory."""
    monkeypatch.setattr(earlier_run, "_NO_WATCHDOG_S", 0.2)
    dead = ArenaFolder(f"test-{os.getpid()}", Path("/x"))
    run = replace(make_run(), arena_dir=str(dead.path))
    run.write()
    owner = json.loads((dead.path / "owner.json").read_text())
    (dead.path / "owner.json").write_text(json.dumps(owner | {"start_ticks": 0}))
    mark_unsaved(dead.path, run.path, ["map", "mesh"], is_being_saved=True)
    dead.let_go()
    try:
        wait_for_earlier_run(run.path, lambda: False)
        assert read_unsaved(dead.path) == (run.path, ("map", "mesh"), False)
    finally:
        dead.remove()


def test_the_claim_of_a_dead_process_is_free(tmp_path: Path):
    claim = (
        "import sys, time; from pathlib import Path;"
        "from hsslam_services.supervisor.folder_claim import FolderClaim;"
        "claim = FolderClaim(Path(sys.argv[1])); print('mine', flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", claim, str(tmp_path)], stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None and other.stdout.readline() == "mine\n"
        with pytest.raises(UserError, match="in use by another run"):
            FolderClaim(tmp_path)
        other.kill()
        other.wait()
    FolderClaim(tmp_path).close()
    FolderClaim(tmp_path).close()


@pytest.mark.e2e
def test_a_log_that_no_recorder_could_begin_is_missed(serve, tmp_path: Path):
    broken = tmp_path / "broken" / "rerun"
    broken.mkdir(parents=True)
    (broken / "__init__.py").write_text("raise ImportError('a library that does not load')")
    run = serve(*SMALL_ROOM, "--frames", "10", prefix=("env", f"PYTHONPATH={broken.parent}"))
    assert run.finish() == 4, run.stderr
    assert "log not saved: " in run.stderr
    assert "log" in run.summary()["not_saved"] and "hsslam-log recover" not in run.stderr
    assert (run.out / "trajectory.txt").exists() and (run.out / "map.safetensors").exists()
