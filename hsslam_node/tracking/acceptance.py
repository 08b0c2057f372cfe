"""Whether an aligned pose is good enough to be published."""

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.geometry.se3 import inverse, se3_log
from hsslam_node.tracking.alignment import Alignment


def is_acceptable(
    alignment: Alignment | None,
    prediction: np.ndarray,
    *,
    after_gap: bool,
    localise_only: bool,
    config: TrackerConfig,
) -> bool:
    """Whether the pose fits map or keyframe and is near `prediction` [4, 4] (camera to world).

    `after_gap`: the camera was lost or unseen for long, so the pose must also fit the reference
    keyframe: in a place that the map says nothing of, few points contradict it. `localise_only`: the map
    does not grow with what the camera sees, so some of that must be on a keyframe.
    """
    if alignment is None or not np.isfinite(alignment.T_world_cam).all():
        return False
    if not _fits(alignment, after_gap, config):
        return False
    if after_gap and not _fits_reference(alignment, config.relocalisation_coverage, config):
        return False
    if localise_only and alignment.surface_coverage < config.localise_coverage:
        return False
    step = se3_log(inverse(prediction) @ alignment.T_world_cam)
    return bool(
        np.linalg.norm(step[:3]) < config.max_step_m
        and np.linalg.norm(step[3:]) < config.max_step_rad
    )


def quality(alignment: Alignment) -> float:
    """0..1: the share of depth points that fit the map; before there is one, the keyframe."""
    ratios = alignment.sdf_inlier_ratio, alignment.surface_inlier_ratio
    return next((float(r) for r in ratios if np.isfinite(r)), 0.0)


def _fits(alignment: Alignment, after_gap: bool, config: TrackerConfig) -> bool:
    """To the map; where that lags behind or somebody stands before it, to the reference keyframe alone.

    Before there is a map, enough points must meet the keyframe: any few fit some surface. Somebody may
    cover much of the keyframe, too: a camera that was tracked until now needs less of it.
    """
    coverage = config.lag_coverage if after_gap else config.relocalisation_coverage
    is_backed = (
        np.isfinite(alignment.sdf_inlier_ratio)
        or alignment.surface_coverage > config.relocalisation_coverage
    )
    return (is_backed and quality(alignment) >= config.min_inlier_ratio) or (
        _fits_reference(alignment, coverage, config)
        and alignment.photometric_inlier_ratio > config.reference_image_agreement
    )


def _fits_reference(alignment: Alignment, coverage: float, config: TrackerConfig) -> bool:
    return (
        alignment.surface_coverage > coverage
        and alignment.surface_inlier_ratio > config.reference_surface_agreement
    )
