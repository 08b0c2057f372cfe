"""A rescue in the process that calls it: of an arena that holds nothing, is gone, or is another user's."""

import os
import shutil
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pytest

from hsslam_node.errors import UserError
from hsslam_services.arena.arena_folder import ArenaFolder
from hsslam_services.artefacts.rescue import rescue
from hsslam_services.commands.rescue import rescue_command
from hsslam_services.run.exit_code import ExitCode
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import read_summary, update_summary


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
