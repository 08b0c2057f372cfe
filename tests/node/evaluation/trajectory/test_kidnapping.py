"""Where the camera is carried, and how its answers are counted."""

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.evaluation.trajectory.kidnapping import kidnapping_plan, kidnapping_score
from hsslam_node.geometry.se3 import inverse, se3_exp, so3_log

# along a line of 6 m, turning by 90 degrees
POSES = np.stack([se3_exp(np.array([0.03 * k, 0, 0, 0, np.pi / 400 * k, 0])) for k in range(200)])


def test_the_plan_shows_each_place_once_and_jumps_far():
    plan = kidnapping_plan(POSES, seed=3, jumps=20, played=6)
    assert plan.order[: plan.before] == tuple(range(0, 200, 2)) and plan.before == 100
    assert len(plan.jumps) == 20 and len(plan.order) == 100 + 20 * 6
    for at in plan.jumps:
        start = plan.order[at]
        assert start % 2 == 1
        assert plan.order[at : at + 6] == tuple(range(start, start + 12, 2))
        step = inverse(POSES[plan.order[at - 1]]) @ POSES[start]
        turn_deg = np.rad2deg(np.linalg.norm(so3_log(step[:3, :3])))
        assert np.linalg.norm(step[:3, 3]) > 0.75 or turn_deg > 40
    assert kidnapping_plan(POSES, seed=3, jumps=20, played=6) == plan
    assert kidnapping_plan(POSES, seed=4, jumps=20, played=6) != plan


def test_a_camera_that_never_moves_cannot_be_carried_away():
    with pytest.raises(UserError, match="75 cm or 40 degrees"):
        kidnapping_plan(np.tile(np.eye(4), (100, 1, 1)), seed=0)


def _case() -> tuple:
    plan = kidnapping_plan(POSES, seed=0, jumps=4, played=14)
    world = se3_exp(np.array([1.0, -2.0, 0.5, 0.3, 0.2, 1.0]))
    estimate = world @ POSES[list(plan.order)]
    return plan, np.ones(len(estimate), bool), estimate


def test_a_perfect_camera():
    plan, tracked, estimate = _case()
    score = kidnapping_score(plan, tracked, estimate, POSES)
    assert score.relocalised == score.jumps == 4 and score.frames_needed == (1, 1, 1, 1)
    assert score.wrong == 0 and score.worst_m < 1e-9 and score.worst_deg < 1e-6
    assert score.lost_before == 0


def test_late_never_and_wrong():
    plan, tracked, estimate = _case()
    first, second, third, fourth = plan.jumps
    tracked[first : first + 9] = False  # the tenth is there
    tracked[second : second + 10] = False  # one too late
    tracked[third : third + 14] = False
    aside, turned = (
        se3_exp(np.array([0.11, 0, 0, 0, 0, 0])),
        se3_exp(np.deg2rad([0, 0, 0, 0, 5.2, 0])),
    )
    estimate[fourth] @= aside
    estimate[fourth + 3] @= turned
    estimate[third] @= aside  # lost: does not count
    tracked[5] = False
    score = kidnapping_score(plan, tracked, estimate, POSES)
    assert score.frames_needed == (10, 11, 0, 0) and score.relocalised == 1
    assert score.wrong == 2 and score.lost_before == 1
    assert score.worst_m == pytest.approx(0.11, abs=1e-9)
    assert score.worst_deg == pytest.approx(5.2, abs=1e-6)
