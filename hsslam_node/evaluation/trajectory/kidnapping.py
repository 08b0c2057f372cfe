"""A camera that jumps to places seen before: plan of the jumps, and score of relocalisation."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.evaluation.trajectory.mean_transform import mean_transform
from hsslam_node.evaluation.trajectory.view_difference import is_far, is_wrong, view_difference
from hsslam_node.geometry.se3 import inverse

WITHIN_FRAMES = 10


@dataclass(frozen=True)
class KidnappingPlan:
    """Which frame of a sequence is shown at each step."""

    order: tuple[int, ...]
    jumps: tuple[int, ...]  # steps after which the camera is elsewhere

    @property
    def before(self) -> int:
        """Steps that build the map."""
        return self.jumps[0]


@dataclass(frozen=True)
class KidnappingScore:
    """Scores over all jumps."""

    jumps: int
    relocalised: int  # within ten frames, at the right place
    frames_needed: tuple[int, ...]  # per jump, the first tracked frame, 1: at once; 0: never
    lost_before: int  # frames lost while the map was built
    wrong: int  # frames with a pose more than 10 cm or 5 degrees off
    worst_m: float
    worst_deg: float


def kidnapping_plan(
    T_world_cam: np.ndarray, seed: int, jumps: int = 20, played: int = 12
) -> KidnappingPlan:
    """Even frames of a sequence in turn; then `jumps` times `played` odd ones from a random place.

    So the map is built from every second frame, and no frame is shown twice. Each jump leads to a
    view at least 75 cm or 40 degrees from the one before it. T_world_cam [N, 4, 4]: true poses.

    Raises:
        UserError: the sequence is too short, or no other view is far enough away.
    """
    rng = np.random.default_rng((seed, len(T_world_cam)))
    order = list(range(0, len(T_world_cam), 2))
    starts = np.arange(1, len(T_world_cam) - 2 * (played - 1), 2)
    at = []
    for _ in range(jumps):
        far = [k for k in starts if is_far(T_world_cam[order[-1]], T_world_cam[k])]
        if not far:
            raise UserError(f"{len(T_world_cam)} frames: expected views 75 cm or 40 degrees apart")
        start = int(rng.choice(far))
        at.append(len(order))
        order += range(start, start + 2 * played, 2)
    return KidnappingPlan(tuple(order), tuple(at))


def kidnapping_score(
    plan: KidnappingPlan, tracked: np.ndarray, T_estimate: np.ndarray, T_truth: np.ndarray
) -> KidnappingScore:
    """Compare published poses with the truth, aligned over the frames that build the map.

    The alignment is the mean difference of their rotations and then of their positions.

    Args:
        tracked: [n] bool, steps with a pose.
        T_estimate: [n, 4, 4] poses as they were published at the time, camera to world.
        T_truth: [N, 4, 4] true poses of the sequence.
    """
    truth = T_truth[list(plan.order)]
    built = np.arange(len(tracked)) < plan.before
    T = mean_transform(T_estimate[built & tracked], truth[built & tracked])
    distance_m, angle_deg = view_difference(inverse(T) @ truth, T_estimate)
    wrong = tracked & is_wrong(distance_m, angle_deg)
    needed = []
    for start, end in zip(plan.jumps, (*plan.jumps[1:], len(tracked)), strict=True):
        found = np.flatnonzero(tracked[start:end])
        right = len(found) > 0 and not wrong[start + found[0]]
        needed.append(int(found[0]) + 1 if right else 0)
    return KidnappingScore(
        jumps=len(plan.jumps),
        relocalised=sum(0 < n <= WITHIN_FRAMES for n in needed),
        frames_needed=tuple(needed),
        lost_before=int((built & ~tracked).sum()),
        wrong=int(wrong.sum()),
        worst_m=float(distance_m[tracked].max()),
        worst_deg=float(angle_deg[tracked].max()),
    )
