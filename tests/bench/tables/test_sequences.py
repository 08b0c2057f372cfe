"""Sequences are found by name in the places where the archives put them."""

import pytest

from hsslam_bench.tables.paper_tables import TABLES
from hsslam_bench.tables.plan import expected_place, find_sequence


@pytest.mark.parametrize(
    ("name", "place", "spec"),
    [
        ("room0", "room0", "replica"),
        ("office3", "Replica/office3", "replica"),
        ("room2", "room_2/imap/00", "replica"),
        ("fr1/desk", "rgbd_dataset_freiburg1_desk", "tum"),
        ("fr3/office", "TUM/rgbd_dataset_freiburg3_long_office_household", "tum"),
        ("scene0000_00", "scannet/scene0000_00", "scannet"),
        ("scene0000_00", "scans/scene0000_00/scene0000_00.sens", "scannet"),
        ("house", "house", "replica"),
    ],
)
def test_a_sequence_is_found(tmp_path, name, place, spec):
    assert find_sequence(tmp_path, name) is None
    (tmp_path / place).mkdir(parents=True)
    assert find_sequence(tmp_path, name) == f"{spec}:{tmp_path / place}"


def test_the_built_in_room_is_always_there(tmp_path):
    assert find_sequence(tmp_path, "room") == "synth:room"


def test_every_row_of_the_tables_has_a_place(tmp_path):
    for table in TABLES.values():
        for name in table.sequences or [row.name for row in table.rows]:
            assert expected_place(tmp_path, name).startswith(str(tmp_path))
