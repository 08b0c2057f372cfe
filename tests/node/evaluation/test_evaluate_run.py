"""A run folder is scored against the truth of its source."""

import json
from functools import partial

import numpy as np
import pytest

from hsslam_node.evaluation.evaluate_run import evaluate_run
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_judge import MeshJudge
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import Trajectory, write_tum
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from tests.few_samples import few_samples  # noqa: F401

OPTIONS = SourceOptions(noise="kinect", synth=SynthOptions(width_px=96, height_px=72, length=60))
SPEC = "synth:room"


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory):
    """A run without fault but for one lost frame; its world is its first camera."""
    folder = tmp_path_factory.mktemp("run")
    truth = open_ground_truth(SPEC, OPTIONS)
    assert truth is not None
    T_world_truth = inverse(truth.T_world_cam[0])
    poses = T_world_truth @ truth.T_world_cam
    write_tum(folder / "trajectory.txt", Trajectory(truth.stamps_ns, poses))
    write_tum(folder / "trajectory_online.txt", Trajectory(truth.stamps_ns[1:], poses[1:]))
    write_tum(folder / "keyframes.txt", Trajectory(truth.stamps_ns[::4], poses[::4]))
    mesh = truth.mesh()
    assert mesh is not None
    mesh.apply_transform(T_world_truth)
    mesh.export(folder / "mesh.ply")
    return folder


@pytest.mark.usefixtures("few_samples")
def test_a_perfect_run_scores_perfectly(run_dir, monkeypatch):
    monkeypatch.setattr(MeshJudge, "open", partial(MeshJudge.open, virtual=6))
    report = evaluate_run(run_dir, SPEC, OPTIONS)
    assert report is not None
    assert report["ate"]["final"]["rmse_m"] < 1e-6
    assert (report["ate"]["online"]["scored"], report["ate"]["online"]["expected"]) == (59, 60)
    assert report["ate"]["keyframes"]["scored"] == 15
    assert report["mesh"]["accuracy_median_m"] < 1e-4
    assert report["mesh"]["completion_ratio_5cm"] > 0.999
    assert report["mesh_literature"]["completion_ratio_5cm"] > 0.99
    json.dumps(report, allow_nan=False)


def test_files_that_are_not_there_are_left_out(run_dir, tmp_path):
    (tmp_path / "trajectory.txt").write_text((run_dir / "trajectory.txt").read_text())
    report = evaluate_run(tmp_path, SPEC, OPTIONS)
    assert report is not None
    assert list(report["ate"]) == ["final"]
    assert "mesh" not in report


def test_too_few_poses_give_none_instead_of_nan(tmp_path):
    write_tum(tmp_path / "trajectory.txt", Trajectory(np.zeros(1, np.int64), np.eye(4)[None]))
    report = evaluate_run(tmp_path, SPEC, OPTIONS)
    assert report is not None
    assert report["ate"]["final"]["rmse_m"] is None


def test_a_source_without_truth_has_no_report(tmp_path):
    assert evaluate_run(tmp_path, "zenoh:") is None
