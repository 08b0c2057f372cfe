"""A camera whose frames are missing for a while: plan of the gaps, and score of the poses after."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.evaluation.trajectory.view_difference import is_far, is_wrong, view_difference
from hsslam_node.geometry.se3 import inverse

_LENGTHS = (4, 6, 9, 14, 20, 30)  # frames from the last before a gap to the first after it
_BETWEEN = (8, 16)  # frames between gaps: from, to (excluded)


@dataclass(frozen=True)
class GapPlan:
    """Which frames of a sequence are shown."""

    order: tuple[int, ...]
    ends: tuple[int, ...]  # steps that show the first frame after a gap


@dataclass(frozen=True)
class GapScore:
    """Scores over all gaps."""

    gaps: int
    at_once: int  # tracked, at the right place, with the first frame after the gap
    found: int  # or with a later one, before the next gap
    wrong: int  # frames more than 10 cm or 5 degrees off, as seen from the last pose before the gap
    worst_m: float
    worst_deg: float


def gap_plan(T_world_cam: np.ndarray, seed: int) -> GapPlan:
    """Stretches of a sequence with gaps of 0.1 to 1 s (at 30 Hz) between them.

    A gap ends before the camera has moved by more than 75 cm or 40 degrees: behind a door it may see
    nothing that it saw before. T_world_cam [N, 4, 4]: true poses.
    """
    rng = np.random.default_rng((seed, len(T_world_cam)))
    order, ends = list(range(int(rng.integers(*_BETWEEN)))), []
    while True:
        last = order[-1]
        start = last + int(rng.choice(_LENGTHS))
        while start < len(T_world_cam) and is_far(T_world_cam[last], T_world_cam[start]):
            start -= 1
        end = start + int(rng.integers(*_BETWEEN))
        if end > len(T_world_cam):
            return GapPlan(tuple(order), tuple(ends))
        ends.append(len(order))
        order += range(start, end)


def gap_score(
    plan: GapPlan, tracked: np.ndarray, T_estimate: np.ndarray, T_truth: np.ndarray
) -> GapScore:
    """Compare the motion since the last pose before each gap with the true one.

    Args:
        tracked: [n] bool, steps with a pose.
        T_estimate: [n, 4, 4] poses as they were published at the time, camera to world.
        T_truth: [N, 4, 4] true poses of the sequence.
    """
    truth = T_truth[list(plan.order)]
    at_once = found = wrong = 0
    worst_m = worst_deg = 0.0
    for start, end in zip(plan.ends, (*plan.ends[1:], len(plan.order)), strict=True):
        last = int(np.flatnonzero(tracked[:start])[-1])
        steps = start + np.flatnonzero(tracked[start:end])
        distance_m, angle_deg = view_difference(
            _motion(truth, last, steps), _motion(T_estimate, last, steps)
        )
        right = ~is_wrong(distance_m, angle_deg)
        at_once += bool(len(steps) and steps[0] == start and right[0])
        found += bool(right.any())
        wrong += int((~right).sum())
        worst_m = max(worst_m, *distance_m, 0.0)
        worst_deg = max(worst_deg, *angle_deg, 0.0)
    return GapScore(len(plan.ends), at_once, found, wrong, worst_m, worst_deg)


def _motion(T_world_cam: np.ndarray, last: int, steps: np.ndarray) -> np.ndarray:
    """[m, 4, 4] from each of the steps to the last before them."""
    return inverse(T_world_cam[last]) @ T_world_cam[steps]
