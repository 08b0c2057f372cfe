"""Scores a finished run folder against the ground truth of its source."""

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from hsslam_node.errors import UserError
from hsslam_node.evaluation.ate import AteResult, ate
from hsslam_node.evaluation.ground_truth import GroundTruth, open_ground_truth
from hsslam_node.evaluation.mesh_metrics import compare_meshes
from hsslam_node.evaluation.visibility import Views
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source import SourceOptions

_CULL_EVERY = 10
_CULL_TOLERANCE_M = 0.03
_TRAJECTORIES = {
    "online": "trajectory_online.txt",
    "final": "trajectory.txt",
    "keyframes": "keyframes.txt",
}


def evaluate_run(
    run_dir: Path | str, spec: str, options: SourceOptions | None = None
) -> dict[str, Any] | None:
    """ATE of the three trajectories of a run and, where the true mesh is known, of its mesh.

    The estimate's world is its first camera frame, the truth's is its own: the mesh is brought into
    the truth's frame by the rigid alignment of the final trajectory (`T_truth_estimate`), and by
    nothing else; an ICP of the mesh would hide drift. Both meshes are culled to what the source's
    own depth images, without added noise, saw from the true poses. Files that are not there are
    left out; None where the source has no truth.

    Returns:
        For `summary.json`: {"protocol": ..., "ate": {"online" | "final" | "keyframes": {...}},
        "mesh": {...}}; NaN comes as None.

    Raises:
        UserError: the source is not there any more, or a file of the run is malformed.
    """
    truth = open_ground_truth(spec, options)
    if truth is None:
        return None
    folder = Path(run_dir)
    results = {
        label: ate(read_tum(folder / name), truth.trajectory)
        for label, name in _TRAJECTORIES.items()
        if (folder / name).exists()
    }
    report: dict[str, Any] = {
        "protocol": {
            "association_s": 0.02,
            "alignment": "SE(3) without scale over all scored poses",
            "mesh_alignment": "the final trajectory's; no ICP",
            "mesh_culling": f"every {_CULL_EVERY}th frame, {_CULL_TOLERANCE_M * 100:g} cm",
        },
        "ate": {label: _ate_fields(result) for label, result in results.items()},
    }
    mesh_file, final = folder / "mesh.ply", results.get("final")
    if mesh_file.exists() and final is not None and math.isfinite(final.rmse_m):
        mesh = _score_mesh(mesh_file, final.T_truth_estimate, truth, spec, options)
        if mesh is not None:
            report["mesh"] = mesh
    return report


def _ate_fields(result: AteResult) -> dict[str, Any]:
    return {
        "rmse_m": _finite(result.rmse_m),
        "mean_m": _finite(result.mean_m),
        "max_m": _finite(result.max_m),
        "scored": result.scored,
        "expected": result.expected,
        "T_truth_estimate": result.T_truth_estimate.tolist(),
    }


def _score_mesh(
    path: Path,
    T_truth_estimate: np.ndarray,
    truth: GroundTruth,
    spec: str,
    options: SourceOptions | None,
) -> dict[str, Any] | None:
    true_mesh = truth.mesh()
    if true_mesh is None:
        return None
    ours = trimesh.load(path, process=False, force="mesh")
    if not isinstance(ours, trimesh.Trimesh):
        raise UserError(f"{path}: holds no triangles: expected a mesh")
    ours = trimesh.Trimesh(ours.vertices, ours.faces, process=False)
    ours.apply_transform(T_truth_estimate)
    views = _true_views(truth, spec, options or SourceOptions())
    metrics = compare_meshes(ours, true_mesh, views)
    return {name: _finite(value) for name, value in asdict(metrics).items()}


def _true_views(truth: GroundTruth, spec: str, options: SourceOptions) -> Views:
    """Every tenth frame at its true pose, without added noise."""
    limit = None if options.frames is None else -(-options.frames // _CULL_EVERY)
    thinned = replace(options, noise="none", stride=options.stride * _CULL_EVERY, frames=limit)
    source = open_source(spec, thinned)
    row_of = {int(stamp): row for row, stamp in enumerate(truth.stamps_ns)}
    frames = [f for f in source.frames() if isinstance(f, Frame) and f.stamp_ns in row_of]
    poses = truth.T_world_cam[[row_of[f.stamp_ns] for f in frames]]
    shape = (0, source.camera.height_px, source.camera.width_px)
    depths = np.stack([f.depth_m() for f in frames]) if frames else np.empty(shape, np.float32)
    return Views(source.camera, poses, depths, _CULL_TOLERANCE_M)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
