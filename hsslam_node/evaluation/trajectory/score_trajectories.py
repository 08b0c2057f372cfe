"""Absolute and relative errors of labelled trajectories; a file of its own as it joins ATE and RPE."""

from collections.abc import Mapping

from hsslam_node.evaluation.trajectory.ate import AteResult, ate
from hsslam_node.evaluation.trajectory.rpe import (
    RpeResult,
    rpe_per_frame,
    rpe_per_metre,
    rpe_per_second,
)
from hsslam_node.geometry.trajectory import Trajectory


def score_trajectories(
    estimates: Mapping[str, Trajectory], truth: Trajectory
) -> tuple[dict[str, AteResult], dict[str, dict[str, RpeResult]]]:
    """ATE of each trajectory, and its RPE per frame (pose), second and metre."""
    ates = {label: ate(estimate, truth) for label, estimate in estimates.items()}
    rpes = {
        label: {
            "frame": rpe_per_frame(estimate, truth),
            "second": rpe_per_second(estimate, truth),
            "metre": rpe_per_metre(estimate, truth),
        }
        for label, estimate in estimates.items()
    }
    return ates, rpes
