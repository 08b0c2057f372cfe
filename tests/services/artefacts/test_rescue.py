"""A rescue in the process that calls it: of an arena that holds nothing, is gone, or is another user's."""

import os
import shutil
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.arena_folder import ArenaFolder, disk_folder
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.unsaved_marker import is_marked, mark_unsaved
from hsslam_services.artefacts.rescue import rescue
from hsslam_services.commands.rescue import rescue_command
from hsslam_services.run.exit_code import ExitCode
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import read_summary, update_summary
from tests.long_pose_log import KEYFRAMES, long_log
from tests.node.sources.files.two_cameras import COLOR


def test_nothing_is_called_saved_if_there_is_nothing(run_info: RunInfo, tmp_path: Path):
    (tmp_path / "run.json").unlink()
    said: list[str] = []
    assert rescue(Path(run_info.arena_dir), tmp_path, said.append) == {}
    assert said == [f"{name}: nothing to save" for name in ("trajectories", "map", "mesh")]
    assert read_summary(tmp_path)["rescued"] == []
    assert not list(tmp_path.glob("*.txt"))
    assert RunInfo.read(tmp_path) == run_info


def test_what_a_second_signal_gave_up_is_not_called_saved(
    run_info: RunInfo, capsys: pytest.CaptureFixture[str]
):
    shutil.rmtree(run_info.arena_dir)
    update_summary(run_info.path, {"not_saved": {}, "given_up": []})
    assert rescue_command([str(run_info.path)]) == ExitCode.SAVED
    assert capsys.readouterr() == (f"{run_info.path}: everything is saved\n", "")
    update_summary(run_info.path, {"given_up": ["map", "mesh"]})
    assert rescue_command([str(run_info.path)]) == ExitCode.NOT_SAVED
    why = "not saved: a second signal ended the run"
    told = [f"{run_info.path}: {name} {why}\n" for name in ("map", "mesh")]
    assert capsys.readouterr() == ("", "".join(told))


@pytest.mark.parametrize("known", [None, {"map": "the disk is full"}])  # None: of an older version
def test_a_rescue_replaces_what_is_not_saved(run_info: RunInfo, known: dict[str, str] | None):
    arena = ArenaFolder("rescued", run_info.path, root=run_info.path)
    info = replace(run_info, arena_dir=str(arena.path))
    info.write()
    info.write_into_arena()
    arena.let_go()
    update_summary(run_info.path, {"not_saved": known})
    with patch.dict(os.environ):  # the command sets some for PyTorch
        assert rescue_command([str(run_info.path)]) == ExitCode.SAVED
    assert read_summary(run_info.path)["not_saved"] == {}
    assert not arena.path.exists()


def test_a_mistyped_option_is_no_run_folder(capsys):
    with pytest.raises(UserError, match="rescue --foo: unknown option: expected one run folder"):
        rescue_command(["--foo"])
    assert rescue_command(["--version"]) == ExitCode.SAVED
    assert capsys.readouterr().out.startswith("hsslam-serve ")


def test_the_run_of_another_user_is_refused_as_that_user_could_not_read_what_is_saved(
    run_info: RunInfo,
):
    if os.geteuid() != 0:
        pytest.skip("only root may give a folder to another user")
    os.chown(run_info.arena_dir, 65534, -1)
    with pytest.raises(
        UserError, match=r"belongs to user (nobody|65534): expected the command to run as"
    ):
        rescue_command([str(run_info.path)])


@pytest.mark.parametrize(
    ("has_moved", "has_earlier_camera"), [(True, False), (False, False), (False, True)]
)
def test_poses_in_a_run_folder_that_was_moved_are_found_and_without_it_keyframes_are_saved(
    run_info: RunInfo, tmp_path: Path, has_moved: bool, has_earlier_camera: bool
):
    """After 34 s at 30 Hz, the older poses lie there."""
    before, now, memory = (tmp_path / name for name in ("before", "now", "memory"))
    for folder in (before, memory):
        folder.mkdir()
    arena_dir = ArenaFolder("rescued", before, root=memory).path
    info = replace(run_info, run_dir=str(before), arena_dir=str(arena_dir))
    info.write_into_arena()
    MapState.create(arena_dir, localise_only=False).map_epoch = 1
    arena = Arena(arena_dir)
    store = KeyframeStore.create(arena, COLOR, 1000.0, 8)
    blank = np.zeros((COLOR.height_px, COLOR.width_px), np.uint16)
    for k, T in enumerate(KEYFRAMES):
        color = np.dstack([blank.astype(np.uint8)] * 3)
        store.append(Frame(k, k + 1, COLOR, color, blank, 1000.0), T)
    long_log(arena)
    if has_earlier_camera:  # whose newest row is among those that are gone
        arena.open("pose_newest")[0] = 5
    arena.move_to_disk("pose_log.000", disk_folder(before, arena_dir))
    if has_moved:
        before.rename(now)
    else:
        shutil.rmtree(before)
    now.mkdir(exist_ok=True)
    update_summary(now, {"given_up": ["trajectories", "mesh"]})
    not_saved = rescue(arena_dir, now, print)
    assert len(read_tum(now / "keyframes.txt")) == len(KEYFRAMES)
    if has_moved:
        assert not not_saved and len(read_tum(now / "trajectory_online.txt")) > 1024
        assert read_summary(now)["given_up"] == ["mesh"]
    else:
        gone = disk_folder(before, arena_dir) / "pose_log.000.bin"
        told = f"{gone}: gone with its run folder, and the poses in it"
        assert not not_saved and not (now / "trajectory.txt").exists()
        assert read_summary(now)["not_saved"] == {"poses": told}


def test_an_arena_that_waits_for_the_user_does_so_after_an_interrupted_rescue(run_info: RunInfo):
    """The next run must not save it by itself: its folder may hold another run by then."""
    arena = Path(run_info.arena_dir)
    mark_unsaved(arena, run_info.path, ["map", "mesh"])
    with (
        patch("hsslam_services.artefacts.rescue._in_own_process", side_effect=KeyboardInterrupt),
        pytest.raises(KeyboardInterrupt),
    ):
        rescue(arena, run_info.path, print)
    assert is_marked(arena)
