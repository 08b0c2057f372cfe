"""Whether the reference keyframe still serves, or another should take its place."""

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import project
from hsslam_node.tracking.alignment import Alignment
from hsslam_node.tracking.reference_keyframe import ReferenceKeyframe

_THIN_COVERAGE = 0.45  # of a frame's points: little, as where somebody stands before the camera
_LESS = 0.85  # than it was


def is_outworn(
    alignment: Alignment, overlap: float, most_covered: float, config: TrackerConfig
) -> bool:
    """Whether the reference keyframe shows too little of the frame, or disagrees with it.

    Args:
        overlap: `reference_overlap` of the frame.
        most_covered: of the points of any frame since it became the reference.
    """
    return (
        overlap < config.reference_overlap
        or is_left_behind(alignment, most_covered, config)
        or alignment.surface_inlier_ratio < config.reference_surface_agreement
        or alignment.photometric_inlier_ratio < config.reference_image_agreement
    )


def is_left_behind(alignment: Alignment, most_covered: float, config: TrackerConfig) -> bool:
    """Whether much less of the frame meets the reference's surface than of frames before it."""
    covered = alignment.surface_coverage
    return covered < config.reference_coverage * most_covered or (
        covered < _THIN_COVERAGE and covered < _LESS * most_covered
    )


def reference_overlap(reference: ReferenceKeyframe, T_cam_ref: np.ndarray, camera: Camera) -> float:
    """Share of the reference's salient pixels that a camera sees; T_cam_ref [4, 4]."""
    points = reference.points[0]
    if len(points) == 0:
        return 0.0
    u, v, z = project(points, camera, T_cam_ref)
    seen = (u >= 0) & (v >= 0) & (u < camera.width_px) & (v < camera.height_px) & (z > 0.1)
    return float(seen.mean())
