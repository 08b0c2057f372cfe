"""Results that a user brings: where they lie, which format, and what is wrong with them."""

from pathlib import Path

import numpy as np
import pytest

from hsslam_bench.peers.outside_results import parsed_result, read_trajectory, results_in
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import GroundTruth, open_ground_truth


@pytest.fixture
def truth(tum_folder: Path) -> GroundTruth:
    found = open_ground_truth(f"tum:{tum_folder}")
    assert found is not None
    return found


def _written(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_files_and_folders_are_named_on_the_command_line(tmp_path: Path):
    both = parsed_result("orb-slam3=run/t.txt,run/m.ply")
    assert (both.name, both.trajectory, both.mesh) == (
        "orb-slam3",
        Path("run/t.txt"),
        Path("run/m.ply"),
    )
    assert parsed_result("rtabmap=t.txt").mesh is None
    assert parsed_result(f"ours={tmp_path}").trajectory == tmp_path / "trajectory.txt"
    (tmp_path / "mesh.ply").write_text("")
    assert parsed_result(f"ours={tmp_path}").mesh == tmp_path / "mesh.ply"


@pytest.mark.parametrize("text", ["t.txt", "=t.txt", "name=", "name=t.txt,"])
def test_what_is_no_result_is_told(text: str):
    with pytest.raises(UserError, match=r"--result .*expected NAME=trajectory\.txt"):
        parsed_result(text)


def test_a_folder_has_results_by_sequence(tmp_path: Path):
    (tmp_path / "house").mkdir()
    for name in ("b.txt", "a.txt", "a.ply", "notes.md"):
        (tmp_path / "house" / name).write_text("")
    found = results_in(tmp_path, "house")
    assert [(r.name, r.mesh is not None) for r in found] == [("a", True), ("b", False)]
    assert results_in(tmp_path, "kitchen") == []


def test_stamps_with_few_digits_are_taken_to_the_frames(tmp_path: Path, truth: GroundTruth):
    stamps_s = truth.stamps_ns / 1e9
    lines = [f"{s + 0.004:.3f} {k} 0 0 0 0 0 1" for k, s in enumerate(stamps_s)]
    lines.append(f"{stamps_s[0] - 5:.3f} 0 0 0 0 0 0 1")  # of no frame
    found = read_trajectory(_written(tmp_path / "t.txt", lines[::-1]), truth)
    np.testing.assert_array_equal(found.stamps_ns[:0:-1], truth.stamps_ns)
    np.testing.assert_array_equal(found.positions[:0:-1, 0], range(5))
    assert found.stamps_ns[0] < truth.stamps_ns[0] - 4e9


def test_poses_without_stamps_are_those_of_the_frames_in_turn(tmp_path: Path, truth: GroundTruth):
    lines = [" ".join(map(str, T.ravel())) for T in truth.T_world_cam]
    found = read_trajectory(_written(tmp_path / "traj.txt", lines), truth)
    np.testing.assert_array_equal(found.stamps_ns, truth.stamps_ns)
    np.testing.assert_allclose(found.T_world_cam, truth.T_world_cam)
    with pytest.raises(UserError, match="4 poses without stamps: expected 5 lines"):
        read_trajectory(_written(tmp_path / "few.txt", lines[:4]), truth)


def test_a_file_that_is_no_trajectory_is_named(tmp_path: Path, truth: GroundTruth):
    with pytest.raises(UserError, match=r"t\.txt:1: .*expected 'timestamp tx ty tz"):
        read_trajectory(_written(tmp_path / "t.txt", ["1 2 3"]), truth)
    with pytest.raises(UserError, match=r"none\.txt: cannot be read"):
        read_trajectory(tmp_path / "none.txt", truth)
