"""The table of sources: what it opens and guesses, and that users read the same in help and documents."""

import re
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.cameras.rows import OAK, ORBBEC
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.registry import SOURCES
from hsslam_node.sources.source_row import SourceRow, guess_source, imported
from hsslam_services.camera.open_source import check_source_exists, open_any_source
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.source_table import (
    ALL_SOURCES,
    OWN_SOURCES,
    comes_over_bus,
    is_live,
    log_place,
)
from tests.repository import ROOT

_LAYOUTS = {
    "tum": ("rgb.txt", "depth.txt", "rgb/", "depth/"),
    "replica": ("traj.txt", "results/"),
    "scannet": ("color/", "depth/", "pose/", "intrinsic/"),
    "7scenes": ("frame-000000.color.png", "frame-000000.depth.png", "frame-000000.pose.txt"),
    "record": ("rgb/", "depth/"),
    "bag": ("metadata.yaml", "run_0.mcap"),
    "mcap": ("run.mcap",),
}


@pytest.mark.parametrize("kind", _LAYOUTS)
def test_a_folder_is_known_by_what_lies_in_it(kind: str, tmp_path: Path):
    for name in _LAYOUTS[kind]:
        path = tmp_path / name
        path.mkdir() if name.endswith("/") else path.touch()
    assert guess_source(str(tmp_path), ALL_SOURCES) == f"{kind}:{tmp_path}"
    with pytest.raises(UserError, match=f"did you mean {kind}:{tmp_path}"):
        open_any_source(str(tmp_path))
    if kind not in ("tum", "record"):
        with pytest.raises(UserError, match=f"did you mean {kind}:{tmp_path}"):
            open_any_source(f"tum:{tmp_path}")


def test_what_is_no_source_is_not_guessed_at(tmp_path: Path):
    scene = tmp_path / "scene.sens"
    assert guess_source(str(tmp_path), ALL_SOURCES) == ""
    assert guess_source(str(scene), ALL_SOURCES) == ""
    assert guess_source("", ALL_SOURCES) == ""
    scene.touch()
    assert guess_source(str(scene), ALL_SOURCES) == f"scannet:{scene}"
    with pytest.raises(UserError) as caught:
        open_any_source(f"tum:{tmp_path}")
    assert "did you mean" not in str(caught.value)


def test_what_a_row_names_is_there():
    for row in ALL_SOURCES:
        for path in (row.opener, row.check, row.ground_truth, row.stamps):
            assert path is None or callable(imported(path)), path
    assert len({row.kind for row in ALL_SOURCES}) == len(ALL_SOURCES)


def test_each_example_is_of_one_row():
    for row in ALL_SOURCES:
        for example in row.examples:
            assert [found.kind for found in ALL_SOURCES if found.matches(example)] == [row.kind]


def test_what_a_run_asks_of_its_source():
    assert [row.kind for row in OWN_SOURCES if is_live(row.examples[0])] == ["realsense", "ros2"]
    assert [row.kind for row in ALL_SOURCES if comes_over_bus(row.examples[0])] == ["zenoh"]
    assert not ServeOptions("zenoh:").has_camera_process
    assert ServeOptions("zenoh").has_camera_process
    assert not is_live("synth:rom")
    assert log_place("mcap:runs/a") == "runs/a"
    assert log_place("tum:runs/a") == log_place("mcap:") == ""
    with pytest.raises(UserError, match="source zenoh:: its frames come over the bus"):
        open_any_source("zenoh:")
    with pytest.raises(UserError, match="did you mean zenoh:"):
        open_any_source("zenoh")


@pytest.mark.parametrize(
    ("spec", "remedy"),
    [
        ("realsense", "expected --stride or --realsense.rate-hz"),
        ("ros2:/camera", "expected --stride"),
        ("zenoh:", "expected the rate in that program"),
    ],
)
def test_what_has_a_clock_of_its_own_takes_no_other_rate(spec: str, remedy: str):
    words = f"--rate-hz 15: source {spec} has a clock of its own: {remedy}"
    with pytest.raises(UserError) as told:
        check_source_exists(ServeOptions(spec, rate_hz=15.0))
    assert str(told.value) == words


def test_the_library_opens_no_log():
    with pytest.raises(UserError, match="expected one of synth:room"):
        open_source("mcap:run.mcap")


@pytest.mark.parametrize(
    ("place", "part"),
    [
        ("README.md", r"^\| reads \|.*$"),
        ("docs/cameras.md", r"\]\]\]-->.*?<!--\[\[\[end"),
    ],
)
def test_users_read_of_every_source_and_of_no_other(place: str, part: str):
    flags = re.S if place != "README.md" else re.M
    (listed,) = re.findall(part, (ROOT / place).read_text(), flags)
    found = re.findall(
        r"(?<!\w)(realsense|orbbec|oak)\b|(?<![\w(])([a-z0-9]+):(?=[\w/`. ])", listed
    )
    kinds = {row.kind for row in (*OWN_SOURCES, ORBBEC, OAK)}
    assert {"".join(groups) for groups in found} - {"sources"} == kinds


def test_help_lists_every_source():
    listed, _, _ = ServeOptions.EPILOGUE.partition("\n\n")
    assert all(text in listed for row in ALL_SOURCES for text in (*row.examples, row.brief))
    assert max(map(len, listed.splitlines())) <= 110


def test_a_row_is_all_that_a_new_kind_needs(tmp_path: Path):
    row = SourceRow(
        kind="mine",
        examples=("mine:FOLDER",),
        brief="a recording",
        about="a recording",
        opener="hsslam_node.sources.record:RecordSource",
        looks_like=lambda path: (path / "mine.txt").exists(),
    )
    (tmp_path / "mine.txt").touch()
    with pytest.raises(UserError, match=f"did you mean mine:{tmp_path}"):
        open_source(str(tmp_path), rows=(*SOURCES, row))
    with pytest.raises(UserError, match="source record:"):
        open_source("mine:nothing-there", rows=(*SOURCES, row))
