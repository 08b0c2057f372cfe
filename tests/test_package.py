"""What is installed is what lies here: `make package` builds and installs it, this is told at once."""

import importlib
import sys
import tomllib
from pathlib import Path

import pytest

from hsslam_node import __version__
from tests.repository import ROOT

_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_an_import_path_is_a_file_path():
    for package in (
        "hsslam_node",
        "hsslam_proto",
        "hsslam_services",
        "hsslam_batch",
        "hsslam_bench",
    ):
        for folder in importlib.import_module(package).__path__:
            assert Path(folder).name == package
            for module in Path(folder).rglob("*.py"):
                assert (module.parent / "__init__.py").exists(), module


@pytest.mark.parametrize(("command", "target"), _PROJECT["project"]["scripts"].items())
def test_every_command_tells_its_version(command, target, monkeypatch, capsys):
    module, _, function = target.partition(":")
    monkeypatch.setattr(sys, "argv", [command, "--version"])
    with pytest.raises(SystemExit) as ended:
        sys.exit(getattr(importlib.import_module(module), function)())
    assert not ended.value.code
    assert capsys.readouterr().out == f"{command} {__version__}\n"


def test_the_version_is_one():
    assert _PROJECT["project"]["version"] == __version__
