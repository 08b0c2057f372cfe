"""Trajectory files."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.trajectory import (
    Trajectory,
    associate,
    format_stamp,
    parse_stamp_ns,
    read_estimate,
    read_tum,
    write_tum,
)

STAMP = st.integers(-(2**62), 2**62)


@given(STAMP)
def test_stamps_are_exact(stamp_ns):
    assert parse_stamp_ns(format_stamp(stamp_ns)) == stamp_ns


@given(st.lists(st.tuples(STAMP, st.lists(st.floats(-3, 3), min_size=6, max_size=6)), max_size=5))
def test_what_is_written_is_read_back(rows):
    poses = np.array([se3_exp(np.array(xi)) for _, xi in rows]).reshape(-1, 4, 4)
    written = Trajectory(np.array([stamp for stamp, _ in rows], np.int64), poses)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "t.txt"
        write_tum(path, written)
        read = read_tum(path)
    np.testing.assert_array_equal(read.stamps_ns, written.stamps_ns)
    np.testing.assert_allclose(read.T_world_cam, written.T_world_cam, atol=1e-7)


@pytest.mark.parametrize(
    "line",
    [
        *("1 2 3", "x 0 0 0 0 0 0 1", "1 0 0 nan 0 0 0 1", "1 0 0 0 0 0 0 0"),
        *(f"{stamp} 0 0 0 0 0 0 1" for stamp in ("nan", "inf", "1e99999999", "-1e999999999")),
    ],
)
def test_a_wrong_line_is_named(tmp_path, line):
    path = tmp_path / "t.txt"
    path.write_text(f"# comment\n0 0 0 0 0 0 0 1\n{line}\n")
    with pytest.raises(UserError, match=r"t\.txt:3"):
        read_tum(path)


def test_a_file_of_an_editor_that_writes_a_byte_order_mark(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text("1.5 1 2 3 0 0 0 1\n", encoding="utf-8-sig")
    assert read_tum(path).stamps_ns.tolist() == [1_500_000_000]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(UserError, match=r"none\.txt"):
        read_tum(tmp_path / "none.txt")


def test_arrays_must_fit_together():
    with pytest.raises(ValueError, match="expected"):
        Trajectory(np.zeros(3, np.int64), np.zeros((2, 4, 4)))


@pytest.mark.parametrize("stamps", [np.array([0.5, 1.5]), np.array([1 << 63, 3], np.uint64)])
def test_stamps_are_whole_nanoseconds(stamps):
    """Seconds would be scored and written as nanoseconds."""
    with pytest.raises(ValueError, match=r"stamps_ns .*: expected whole nanoseconds, int64"):
        Trajectory(stamps, np.tile(np.eye(4), (2, 1, 1)))


def test_a_pose_that_is_not_finite_is_named():
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1, 0, 3] = np.nan
    with pytest.raises(ValueError, match="pose 1 of 3 is not finite"):
        Trajectory(np.arange(3), poses)


def test_other_integers_and_lists_are_taken():
    poses = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    for stamps in (np.array([5, 30], np.uint64), np.array([5, 30], np.int32), [5, 30]):
        taken = Trajectory(stamps, poses)
        assert (taken.stamps_ns.dtype, taken.T_world_cam.dtype) == (np.int64, np.float64)
        assert associate(taken.stamps_ns, taken.stamps_ns, 20) == [(0, 0), (1, 1)]
    assert len(Trajectory([], np.zeros((0, 4, 4)))) == 0


@pytest.mark.parametrize(
    "title",
    [
        "#timestamp, p_x, p_y, p_z, q_w, q_x, q_y, q_z",
        "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y []",
        "# t tx ty tz qw qx qy qz",
    ],
)
def test_columns_in_another_order_are_refused(tmp_path, title):
    path = tmp_path / "t.txt"
    path.write_text(f"{title}\n0,0,0,0,1,0,0,0\n")
    with pytest.raises(UserError, match=r"t\.txt:1: '.*': qw is before qx: expected 'timestamp tx"):
        read_tum(path)
    path.write_text("# timestamp tx ty tz qx qy qz qw\n0,0,0,0,1,0,0,0\n")
    assert len(read_tum(path)) == 1


def test_a_stamp_of_an_estimate_has_one_pose(tmp_path):
    path = tmp_path / "t.txt"
    path.write_text("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n")
    assert len(read_estimate(path)) == 3  # twice the same pose
    path.write_text("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n2 0 0 1 0 0 0 1\n")
    with pytest.raises(UserError, match=r"t\.txt: stamp 2\.000000000 has several poses"):
        read_estimate(path)
