"""`hsslam` knows every command that is installed, and runs it."""

import tomllib

import pytest

from hsslam_node import __version__
from hsslam_services.commands.hsslam import COMMANDS, main
from tests.repository import ROOT

_PYPROJECT = ROOT / "pyproject.toml"


def test_the_commands_are_those_that_are_installed():
    scripts = tomllib.loads(_PYPROJECT.read_text())["project"]["scripts"]
    assert scripts.keys() == {"hsslam"} | {f"hsslam-{name}" for name in COMMANDS}


def test_version_and_list(capsys: pytest.CaptureFixture[str]):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"hsslam {__version__}\n"
    assert main([]) == 0
    shown = capsys.readouterr().out
    assert all(f"hsslam-{name} " in shown for name in COMMANDS)


def test_a_command_runs_with_its_own_exit_code(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("sys.argv", [])
    assert main(["log", "info", "nowhere.mcap"]) == 2
    assert "nowhere.mcap: No such file" in capsys.readouterr().err
    assert main(["sreve"]) == 2
    assert "sreve: expected one of serve, ctl" in capsys.readouterr().err
