"""Ground truth goes with the frames that a source delivers, and nowhere else."""

import ast
from pathlib import Path

import numpy as np
import pytest

import hsslam_node
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions


def test_tum_truth_is_paired_with_the_frames(tum_folder):
    truth = open_ground_truth(f"tum:{tum_folder}", SourceOptions(stride=2))
    assert truth is not None
    np.testing.assert_array_equal(truth.T_world_cam[:, 0, 3], [0, 2, 4])
    frames = open_source(f"tum:{tum_folder}", SourceOptions(stride=2)).frames()
    assert [f.stamp_ns for f in frames] == list(truth.stamps_ns)
    assert truth.mesh() is None


def test_replica_truth_selects_like_the_source(replica_folder):
    truth = open_ground_truth(f"replica:{replica_folder}", SourceOptions(frames=2))
    assert truth is not None
    np.testing.assert_array_equal(truth.T_world_cam[:, 0, 3], [0, 1])


def test_sources_without_truth(tum_folder, replica_folder):
    (tum_folder / "groundtruth.txt").unlink()
    (replica_folder / "traj.txt").unlink()
    assert open_ground_truth(f"tum:{tum_folder}") is None
    assert open_ground_truth(f"replica:{replica_folder}") is None
    assert open_ground_truth("zenoh:") is None


def test_malformed_truth_is_named(replica_folder):
    (replica_folder / "traj.txt").write_text("1 2 3\n")
    with pytest.raises(UserError, match=r"traj\.txt"):
        open_ground_truth(f"replica:{replica_folder}")


def test_only_the_evaluator_can_see_the_truth():
    """Nothing in the library outside `evaluation` imports it."""
    root = Path(hsslam_node.__file__).parent
    for path in root.rglob("*.py"):
        if path.is_relative_to(root / "evaluation"):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(n.startswith("hsslam_node.evaluation") for n in names), path


@pytest.mark.parametrize(
    ("spec", "count"), [("tum:kitchen", 380), ("tum:livingroom", 211), ("replica:house", 600)]
)
def test_real_sequences(test_data, spec, count):
    kind, _, name = spec.partition(":")
    truth = open_ground_truth(f"{kind}:{test_data / name}")
    assert truth is not None
    assert len(truth.stamps_ns) == count
    R = truth.T_world_cam[:, :3, :3]
    np.testing.assert_allclose(R @ R.swapaxes(1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-5)
