"""Results of an evaluation as JSON, and the protocol that is printed beside them."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hsslam_node.evaluation import consistency, image_quality
from hsslam_node.evaluation.mesh import mesh_judge, mesh_metrics, published_protocol
from hsslam_node.evaluation.mesh.virtual_views import LEAST_OBSERVED, MOVED_M, TURNED_RAD

_NOT_WRITTEN = ("stamps_ns", "errors_m")  # one value a frame: for plots


def protocol() -> dict[str, Any]:
    """How the figures are computed, to reproduce them."""
    return {
        "association_s": 0.02,
        "alignment": "SE(3) without scale over all scored poses",
        "rpe": "every scored pose to the next, to the first 1 s later, to the first 1 m of path on",
        "mesh_samples": mesh_metrics.SAMPLES,
        "mesh": "exact: points to triangles; aligned by the final trajectory, no ICP; culled: every "
        f"{mesh_judge.CULL_EVERY}th frame (of long runs {mesh_judge.MOST_GIVEN} at most) at its true "
        "pose, its true depth where its sensor measured, "
        f"{100 * mesh_judge.CULL_TOLERANCE_M:g} cm",
        "mesh_literature": "as published with Co-SLAM: points to points; aligned by the final "
        f"trajectory, then by ICP (point to point, {100 * published_protocol.ICP_WITHIN_M:g} cm); "
        f"culled: the same frames and {mesh_judge.CULL_VIRTUAL} virtual views, by the depth of each "
        f"mesh itself, {100 * published_protocol.TOLERANCE_M:g} cm",
        "virtual_views": f"a given camera moved by up to {MOVED_M:g} m and turned by up to "
        f"{np.rad2deg(TURNED_RAD):.0f} degrees, {LEAST_OBSERVED:.0%} of its pixels observed",
        "depth_l1": "pixels whose true surface a given camera observed; a hole counts in full",
        "rendering": f"every {image_quality.EVERY}th frame that was no keyframe, or frames between if all "
        "were; pixels with depth, which places the samples of the field",
        "views": "the same frames and pixels, drawn by the map alone: its surface, colours of keyframes",
        "consistency": f"a pair every {consistency.START_EVERY} frames, pixels within "
        f"{100 * consistency.SAME_SURFACE_M:g} cm in depth: median over pairs of the median depth "
        "difference; mean over pairs of 1 - NCC of grey values",
    }


def scores_as_json(value: Any) -> Any:
    """Dataclasses as mappings, arrays as lists, NaN and infinity as None; the rest as it is."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [f.name for f in dataclasses.fields(value) if f.name not in _NOT_WRITTEN]
        return {name: scores_as_json(getattr(value, name)) for name in fields}
    if isinstance(value, Mapping):
        return {str(key): scores_as_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return scores_as_json(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [scores_as_json(item) for item in value]
    if isinstance(value, np.generic):
        return scores_as_json(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
