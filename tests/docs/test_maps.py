"""What docs/maps.md says of asking a map, run as it is printed, on a map of the small room."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_services.commands.maps.command import main
from tests.repository import ROOT
from tests.small_room import SMALL, mapped_room

_SECTION = re.compile(r"^## Ask a map for distances\n(.*?)^## ", re.M | re.S)


@pytest.fixture
def section(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The text, in a folder that has what it names."""
    room = mapped_room()
    checkpoint = map_snapshot(room.store, room.parameters, SMALL.sampling)
    save_checkpoint(tmp_path / "map.safetensors", checkpoint)
    np.savetxt(tmp_path / "places.txt", [[0.0, -0.1, 0.5]])
    monkeypatch.chdir(tmp_path)
    (found,) = _SECTION.findall((ROOT / "docs/maps.md").read_text())
    return found


def test_the_commands(section, capsys):
    commands = re.findall(r"^\$ hsslam-map (.*)$", section, re.M)
    assert len(commands) == 2
    for command in commands:
        assert main(shlex.split(command)) == 0
    told, printed = (text.splitlines() for text in (capsys.readouterr().out, section))
    head = next(line for line in printed if "distance, m" in line)
    assert told[0].split() == head.split()


def test_the_python_example(section, capsys):
    (block,) = re.findall(r"^```python\n(.*?)^```", section, re.M | re.S)
    exec(compile(block, "docs/maps.md", "exec"), {})
    hits, sphere, box = capsys.readouterr().out.splitlines()
    assert hits.endswith("[ True]")
    assert (sphere, box) == ("[ True]", "[ True]")
    mesh = trimesh.load_mesh("room.ply")
    assert len(mesh.faces) > 1000
