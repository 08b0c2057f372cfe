"""A perfect result scores perfectly, a poor one does not, and its text says which is which."""

from functools import partial

import numpy as np
import pytest

from hsslam_bench.peers import score as scoring
from hsslam_bench.peers.score import score
from hsslam_bench.peers.table import PeerRow, in_words, peers_markdown
from hsslam_node.evaluation.evaluate import Wanted
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from tests.few_samples import few_samples  # noqa: F401

_ROOM = SourceOptions(frames=41, synth=SynthOptions(width_px=96, height_px=72))


@pytest.mark.usefixtures("few_samples")
def test_trajectory_agreement_and_mesh_by_both_protocols(monkeypatch):
    monkeypatch.setattr(scoring, "Wanted", partial(Wanted, cull_views=6))
    truth = open_ground_truth("synth:room", _ROOM)
    mesh = truth.mesh() if truth else None
    assert truth is not None and mesh is not None
    T_world_truth = inverse(truth.T_world_cam[0])
    poses = T_world_truth @ truth.T_world_cam
    mesh.apply_transform(T_world_truth)
    exact = score("synth:room", _ROOM, Trajectory(truth.stamps_ns, poses), mesh)
    assert (exact["scored"], exact["expected"]) == (41, 41)
    assert exact["pairs"] == exact["possible_pairs"] == 2
    assert exact["ate_cm"] == pytest.approx(0, abs=1e-6)
    assert exact["accuracy_cm"] == pytest.approx(0, abs=1e-4)
    assert exact["completion_pct"] == pytest.approx(100)
    assert exact["lit_accuracy_cm"] == pytest.approx(1.1, abs=0.4)  # the floor of its points
    assert exact["depth_mm"] is not None and exact["depth_mm"] < 10

    moved = poses.copy()
    moved[:, 0, 3] += 0.1 * np.sin(np.arange(41))
    poor = score("synth:room", _ROOM, Trajectory(truth.stamps_ns[:-1], moved[:-1]), None)
    assert (poor["scored"], poor["expected"]) == (40, 41)
    assert poor["ate_cm"] is not None and poor["ate_cm"] > 5
    assert poor["accuracy_cm"] is None

    text = in_words(exact)
    assert (
        "41/41" in text
        and "pairs 2/2" in text
        and "mesh exact acc. / comp. cm / % 0.00 / 0.00 / 100.0" in text
    )
    assert "mesh" not in in_words(poor)
    lines = peers_markdown(
        [PeerRow("room", "exact", exact), PeerRow("room", "dead", error="ended")]
    ).splitlines()
    assert len({line.count("|") for line in lines}) == 1
    assert "failed" in lines[-1]
