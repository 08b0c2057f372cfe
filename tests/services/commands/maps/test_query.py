"""`hsslam-map query` on a map of the small room."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.errors import UserError
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_services.commands.maps.command import main
from hsslam_services.commands.maps.query import read_points
from tests.small_room import SMALL, mapped_room

PLACES = np.array([[0.0, -0.1, 0.5], [0.3, 0.25, 1.25], [0.0, 0.0, 99.0]])


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    room = mapped_room()
    path = tmp_path_factory.mktemp("map") / "room.safetensors"
    save_checkpoint(path, map_snapshot(room.store, room.parameters, SMALL))
    return path


def test_places_come_from_options_and_files(saved, tmp_path, capsys):
    (tmp_path / "places.csv").write_text("# x, y, z\n0.3, 0.25, 1.25\n\n0 0 99  # far away\n")
    np.save(tmp_path / "places.npy", PLACES[1:])
    for file in ("places.csv", "places.npy"):
        points = ["--points", str(tmp_path / file)]
        assert main(["query", str(saved), "--json", "--point", "0", "-0.1", "0.5", *points]) == 0
        told = json.loads(capsys.readouterr().out)
        found = SavedMap.open(saved, "cpu").query(PLACES)
        np.testing.assert_allclose([one["point"] for one in told], PLACES)
        assert [one["distance_m"] for one in told[:2]] == found.distance_m[:2].tolist()
        assert told[2]["distance_m"] is None and np.isnan(found.distance_m[2])
        np.testing.assert_allclose([one["gradient"] for one in told], found.gradient)
        assert [one["known"] for one in told] == [True, True, False]
        np.testing.assert_allclose([one["certainty"] for one in told], found.certainty)


def test_the_table_has_a_line_for_each_place(saved, capsys):
    assert (
        main(["query", str(saved), "--point", "0", "-0.1", "0.5", "--point", "0", "0", "99"]) == 0
    )
    head, near, far = capsys.readouterr().out.splitlines()
    assert (
        re.sub(r" {2,}", "|", head.strip()) == "x, m|y, m|z, m|distance, m|gradient|known|certainty"
    )
    told = SavedMap.open(saved, "cpu").query(PLACES[:1]).distance_m[0]
    assert near.split()[:4] == ["0", "-0.1", "0.5", f"{told:.3f}"] and " yes " in near
    assert far.split()[3] == "-" and far.split()[-2:] == ["no", "0.00"]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("qeury",), "qeury: expected query, grid, esdf, export, merge; did you mean query?"),
        (("query",), "query: no map: expected a run folder or map.safetensors"),
        (("query", "m"), "query: no point: expected --point X Y Z or --points FILE"),
        (("query", "m", "--point", "1", "2"), "--point 1 2: expected X Y Z in metres"),
        (("query", "m", "--point", "1", "2", "inf"), "--point 1 2 inf: expected X Y Z in metres"),
        (("query", "m", "--point", "1", "2", "east"), "--point east: expected a number"),
        (("query", "m", "--far-m", "13"), "--far-m 13.0: expected metres above 0, 12 at most"),
        (("query", "m", "--points", "/nowhere"), "--points /nowhere: No such file"),
        (("query", "/nowhere", "--point", "1", "2", "3"), "/nowhere: no such file: expected a map"),
    ],
)
def test_bad_input_is_one_line_and_code_2(arguments, text, capsys):
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert text in told and told.count("\n") == 1


@pytest.mark.parametrize("text", ["1 2\n", "a b c\n", "1 2 nan\n", "1 2 3 4 5 6\n"])
def test_a_file_that_holds_no_points_is_bad_input(text, tmp_path, capsys):
    (tmp_path / "p.txt").write_text(text)
    assert main(["query", "m", "--points", str(tmp_path / "p.txt")]) == 2
    told = capsys.readouterr().err
    assert f"--points {tmp_path / 'p.txt'}: " in told and told.count("\n") == 1


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "got 0"),
        (b"PK\3\4, and cut off", "magic string is not correct"),
        (np.zeros(3, [("x", "f4"), ("y", "f4"), ("z", "f4")]), "Cannot cast array data"),
        (np.zeros((2, 3), np.complex64), "Cannot cast array data"),
        (np.zeros((2, 2)), "[2, 2]"),
    ],
)
def test_an_array_that_holds_no_points_is_bad_input(data, text, tmp_path, capsys):
    path = tmp_path / "p.npy"
    path.write_bytes(data) if isinstance(data, bytes) else np.save(path, data)
    assert main(["query", "m", "--points", str(path)]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"error: --points {path}: ") and told.count("\n") == 1
    assert text in told and "expected " in told and "[N, 3]" in told


def test_a_header_that_claims_more_than_memory_holds_is_bad_input(tmp_path):
    path = tmp_path / "p.npy"
    with path.open("wb") as stream:
        told = {"descr": "<f8", "fortran_order": False, "shape": (10**15, 3)}
        np.lib.format.write_array_header_1_0(stream, told)
    with pytest.raises(UserError, match=r"p\.npy: Unable to allocate .*: expected lines X Y Z"):
        read_points(path)


def test_a_line_that_holds_no_point_is_named(tmp_path):
    path = tmp_path / "p.txt"
    path.write_text("\ufeff1 2 3\n# nothing\n4,5,6  # last\n7 8\n", encoding="utf-8")
    with pytest.raises(UserError, match=r"p\.txt: line 4: '7 8': expected lines X Y Z"):
        read_points(path)
    path.write_text("\ufeff1 2 3\n# nothing\n4,5,6  # last\n", encoding="utf-8")
    np.testing.assert_array_equal(read_points(path), [[1, 2, 3], [4, 5, 6]])


def test_a_file_without_points_is_no_points(tmp_path):
    (tmp_path / "p.txt").write_text("# nothing\n")
    assert read_points(tmp_path / "p.txt").shape == (0, 3)
