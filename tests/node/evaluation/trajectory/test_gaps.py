"""Where frames are missing, and how the poses after are counted."""

import numpy as np
import pytest

from hsslam_node.evaluation.trajectory.gaps import gap_plan, gap_score
from hsslam_node.geometry.se3 import se3_exp

POSES = np.stack([se3_exp(np.array([0.03 * k, 0, 0, 0, np.pi / 400 * k, 0])) for k in range(200)])


def test_the_plan_leaves_frames_out_between_stretches():
    plan = gap_plan(POSES, seed=3)
    steps = np.diff(plan.order)
    assert len(plan.ends) >= 5 and max(plan.order) < 200
    assert [at for at in range(1, len(plan.order)) if steps[at - 1] > 1] == list(plan.ends)
    # at 3 cm a frame 26 are too far
    assert {4, 25} <= set(steps) <= {1, 4, 6, 9, 14, 20, 25}
    assert min(np.diff(plan.ends)) >= 8
    assert gap_plan(POSES, seed=3) == plan != gap_plan(POSES, seed=4)


def _case() -> tuple:
    plan = gap_plan(POSES, seed=0)
    world = se3_exp(np.array([1.0, -2.0, 0.5, 0.3, 0.2, 1.0]))
    return plan, np.ones(len(plan.order), bool), world @ POSES[list(plan.order)]


def test_a_perfect_camera():
    plan, tracked, estimate = _case()
    score = gap_score(plan, tracked, estimate, POSES)
    assert score.gaps == score.at_once == score.found == len(plan.ends)
    assert score.wrong == 0 and score.worst_m < 1e-9 and score.worst_deg < 1e-6


def test_late_never_and_wrong():
    plan, tracked, estimate = _case()
    first, second, third = plan.ends[:3]
    tracked[first] = False  # one late
    tracked[second:third] = False
    estimate[second] @= se3_exp(np.array([5.0, 0, 0, 0, 0, 0]))  # lost: does not count
    estimate[third] @= se3_exp(np.array([0.11, 0, 0, 0, 0, 0]))
    estimate[third + 1] @= se3_exp(np.deg2rad([0, 0, 0, 0, 5.2, 0]))
    score = gap_score(plan, tracked, estimate, POSES)
    assert (score.gaps - score.at_once, score.gaps - score.found) == (3, 1)
    assert score.wrong == 2
    assert score.worst_m == pytest.approx(0.11, abs=1e-9)
    assert score.worst_deg == pytest.approx(5.2, abs=1e-6)
