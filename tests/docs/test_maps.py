"""What docs/maps.md says of questions, merging, robots and other tools, run as printed, on small maps."""

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
from tests.two_sessions import FIRST, SECOND, saved_session

_SECTIONS = dict(
    re.findall(r"^## ([^\n]*)\n(.*?)(?=^## )", (ROOT / "docs/maps.md").read_text(), re.M | re.S)
)
# a test of a whole run makes a fragment and merges it
_MERGE = _SECTIONS["Merge two runs"].partition("### Merge a fragment")[0]
_ASK = _SECTIONS["Query distances in a map"]
_ROBOTS = _SECTIONS["Export a map to Nav2 and planners"]
_TOOLS = _SECTIONS["Export a map to other tools"]


@pytest.fixture(autouse=True)
def in_a_folder_with_a_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All that the page names is there."""
    room = mapped_room()
    checkpoint = map_snapshot(room.store, room.parameters, SMALL)
    save_checkpoint(tmp_path / "map.safetensors", checkpoint)
    np.savetxt(tmp_path / "places.txt", [[0.0, -0.1, 0.5]])
    monkeypatch.chdir(tmp_path)


def _run(section: str, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Run the commands of a section; the lines that they print."""
    for command in re.findall(r"^\$ hsslam-map (.*)$", section, re.M):
        assert main(shlex.split(command)) == 0
    return capsys.readouterr().out.splitlines()


def _expect_same_words(told: list[str], printed: list[str]) -> None:
    """Assert that the lines are those of the page, with other numbers."""
    ours, theirs = ([re.sub(r"-?[\d.]+", "N", line) for line in of] for of in (told, printed))
    assert ours == theirs


def _execute(section: str, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Run the Python of a section; the lines that it prints."""
    (block,) = re.findall(r"^```python\n(.*?)^```", section, re.M | re.S)
    exec(compile(block, "docs/maps.md", "exec"), {})
    return capsys.readouterr().out.splitlines()


def test_two_runs_are_merged(capsys):
    Path("runs").mkdir()
    saved_session(Path("runs/monday"), FIRST)
    saved_session(Path("runs/tuesday"), SECOND)
    saved_session(Path("runs/elsewhere"), SECOND, mirrored=True)
    commands = re.findall(r"^\$ hsslam-map (.*)$", _MERGE, re.M)
    assert [main(shlex.split(command)) for command in commands] == [0, 2]
    told = capsys.readouterr()
    printed = re.findall(r"^(?:runs/tuesday meets|results:|error:) .*$", _MERGE, re.M)
    _expect_same_words((told.out + told.err).splitlines(), printed)
    assert len(trimesh.load_mesh("runs/both/mesh.ply").faces) > 1000


def test_a_map_is_asked(capsys):
    told = _run(_ASK, capsys)
    head = next(line for line in _ASK.splitlines() if "distance, m" in line)
    assert told[0].split() == head.split()


def test_a_map_is_asked_in_python(capsys):
    hits, sphere, box, is_certain = _execute(_ASK, capsys)
    assert hits.endswith("[ True]")
    assert (sphere, box) == ("[ True]", "[ True]") and is_certain in ("[ True]", "[False]")
    mesh = trimesh.load_mesh("room.ply")
    assert len(mesh.faces) > 1000


def test_a_map_is_written_for_robots(capsys):
    told = _run(_ROBOTS, capsys)
    printed = [
        line
        for line in _ROBOTS.splitlines()
        if re.match(r"direction up|map\.yaml, |esdf\.npz: ", line)
    ]
    assert len(printed) == 4
    _expect_same_words(told, printed)
    assert Path("map.pgm").read_bytes().startswith(b"P5")
    (distance_m,) = _execute(_ROBOTS, capsys)
    assert 0.1 < float(distance_m) < 2.0


def test_a_map_is_written_for_other_tools(capsys):
    told = _run(_TOOLS, capsys)
    assert [line.partition(":")[0] for line in told] == [
        "room.ply",
        "room.glb",
        "textured.glb",
        "room.usd",
        "room.pcd",
        "room",
        "scene",
    ]
    assert len(trimesh.load_mesh("room.ply").faces) > 1000
