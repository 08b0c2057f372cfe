"""Scores a finished run folder against the ground truth of its source, for `summary.json`."""

import math
from pathlib import Path
from typing import Any

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.trajectory.score_trajectories import score_trajectories
from hsslam_node.geometry.trajectory import Trajectory, read_tum
from hsslam_node.sources.options.source import SourceOptions

_TRAJECTORIES = {
    "online": "trajectory_online.txt",
    "final": "trajectory.txt",
    "keyframes": "keyframes.txt",
}


def evaluate_run(
    run_dir: Path | str, spec: str, options: SourceOptions | None = None
) -> dict[str, Any] | None:
    """ATE and RPE of the three trajectories of a run, and scores of its mesh if the true one is known.

    The estimate's world is its first camera frame, the truth's is its own. Only the rigid alignment of
    the final trajectory (`T_truth_estimate`) moves the mesh into the truth's frame: an ICP would hide
    drift (only "mesh_literature" adds one). Missing files are left out. None: the source has no truth.
    `hsslam-eval` measures more, by the same protocol.

    Returns:
        {"protocol": ..., "ate": {"online" | "final" | "keyframes": {...}}, "rpe": {...},
        "mesh": {...}, "mesh_literature": {...}}; NaN is None.

    Raises:
        UserError: the source is missing, or a file of the run is malformed.
    """
    options = options or SourceOptions()
    truth = open_ground_truth(spec, options)
    if truth is None:
        return None
    # late: both import trimesh, and most logs have no ground truth
    from hsslam_node.evaluation.mesh.mesh_judge import MeshJudge, load_mesh
    from hsslam_node.evaluation.scores import protocol, scores_as_json

    folder = Path(run_dir)
    ates, rpes = score_trajectories(run_trajectories(folder), truth.trajectory)
    report: dict[str, Any] = {"protocol": protocol(), "ate": ates, "rpe": rpes}
    final, mesh_file = ates.get("final"), folder / "mesh.ply"
    if mesh_file.exists() and final is not None and math.isfinite(final.rmse_m):
        judge = MeshJudge.open(truth, spec, options)
        if judge is not None:
            mesh = load_mesh(mesh_file)
            mesh.apply_transform(final.T_truth_estimate)
            report["mesh"] = scores_as_json(judge.score(mesh))
            report["mesh_literature"] = judge.score_as_published(mesh)
            depth = judge.score_depth(mesh)
            report["mesh"] |= {"depth_l1_m": depth.mean_m, "depth_l1_views": depth.views}
    return scores_as_json(report)


def run_trajectories(folder: Path) -> dict[str, Trajectory]:
    """The trajectories that a run folder has, by label.

    Raises:
        UserError: one of them is malformed.
    """
    return {
        label: read_tum(folder / name)
        for label, name in _TRAJECTORIES.items()
        if (folder / name).exists()
    }
