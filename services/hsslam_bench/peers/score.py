"""The scores of a trajectory and a mesh of any system: the figures of `hsslam-eval`, by metric."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import trimesh

from hsslam_node.evaluation.evaluate import Evaluator, Subject, Wanted
from hsslam_node.evaluation.scores import scores_as_json
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.options.source import SourceOptions

GAP_FRAMES = 30
Values = dict[str, float | None]  # by metric; None: no value
_MESH = (("accuracy_mean_m", "accuracy_cm"), ("completion_mean_m", "completion_cm"))
_PROTOCOLS = {"mesh": "", "mesh_literature": "lit_"}  # key in the figures: prefix of a metric


def score(
    source: str,
    options: SourceOptions,
    trajectory: Trajectory,
    mesh: Path | trimesh.Trimesh | None,
    name: str = "",
) -> Values:
    """Frames scored and expected, ATE, RPE, consistency of frames, and the mesh by both protocols.

    `name`: of a file that should have poses of the source; empty: it may have none.

    Raises:
        UserError: the source or the mesh is not readable, or no pose of the file belongs to a true one.
    """
    subject = Subject(source, options, {"final": trajectory}, mesh)
    evaluator = Evaluator(subject, Wanted(depth_views=0, rendering=False))
    if name:
        evaluator.expect_pairs(name)
    found = evaluator.evaluate()
    figures: dict[str, Any] = scores_as_json(found.figures)
    ate = figures.get("ate", {}).get("final", {})
    rpe = figures.get("rpe", {}).get("final", {}).get("frame", {})
    agreement = _agreement(figures)
    values: Values = {
        "scored": ate.get("scored"),
        "expected": ate.get("expected"),
        "ate_cm": _times(100, ate.get("rmse_m")),
        "rpe_cm": _times(100, rpe.get("translation_rmse_m")),
        "depth_mm": _times(1000, agreement.get("depth_median_m")),
        "one_minus_ncc": agreement.get("one_minus_ncc"),
        "pairs": agreement.get("pairs"),
        "possible_pairs": agreement.get("possible"),
    }
    for protocol, before in _PROTOCOLS.items():
        scores = figures.get(protocol, {})
        values |= {f"{before}{metric}": _times(100, scores.get(key)) for key, metric in _MESH}
        values[f"{before}completion_pct"] = _times(100, scores.get("completion_ratio_5cm"))
    return values


def _agreement(figures: Mapping[str, Any]) -> Mapping[str, Any]:
    rows = figures.get("consistency", {}).get("estimated", [])
    return next((row for row in rows if row["gap_frames"] == GAP_FRAMES), {})


def _times(factor: float, value: float | None) -> float | None:
    return None if value is None else factor * value
