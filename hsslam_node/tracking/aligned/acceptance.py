"""Whether an aligned pose is published, and whether the reference keyframe is replaced."""

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import project
from hsslam_node.geometry.se3 import inverse, se3_log, so3_log
from hsslam_node.place_recognition.dense_agreement import dense_agreement
from hsslam_node.tracking.alignment.align import Alignment
from hsslam_node.tracking.keyframes.reference_keyframe import ReferenceKeyframe
from hsslam_node.tracking.tracked_frame import TrackedFrame


def is_acceptable(
    alignment: Alignment | None,
    prediction: np.ndarray,
    *,
    after_gap: bool,
    localise_only: bool,
    config: TrackerConfig,
) -> bool:
    """Whether the pose fits map or keyframe and is near `prediction` [4, 4] (camera to world).

    `after_gap`: the camera was lost, or its last aligned frame is old. The pose must then also fit the
    reference keyframe, as few points contradict a wrong pose where there is no map. `localise_only`: the
    reference must show a part of the frame, as no keyframe is added. A term that is off does not count.
    """
    if alignment is None or not np.isfinite(alignment.T_world_cam).all():
        return False
    if not _fits(alignment, after_gap, config):
        return False
    if after_gap and not _fits_surface(alignment, config.relocalisation_coverage, config):
        return False
    is_beyond = alignment.surface_coverage < config.localise_coverage
    if localise_only and config.surface_weight > 0 and is_beyond:
        return False
    step = se3_log(inverse(prediction) @ alignment.T_world_cam)
    return bool(
        np.linalg.norm(step[:3]) < config.max_step_m
        and np.linalg.norm(step[3:]) < config.max_step_rad
    )


def quality(alignment: Alignment) -> float:
    """0..1: the share of depth points that fit the map; without a map there, the keyframe."""
    ratios = alignment.sdf_inlier_ratio, alignment.surface_inlier_ratio
    return next((float(r) for r in ratios if np.isfinite(r)), 0.0)


def _fits(alignment: Alignment, after_gap: bool, config: TrackerConfig) -> bool:
    """Whether the pose fits the map, or else the keyframe alone: the map may lag, or a person may hide it.

    Without a map, enough points must meet the keyframe, as a few points fit any surface. A person may also
    hide much of the keyframe, so a camera that was tracked until now needs less coverage. If both terms of
    the keyframe are off, the map decides.
    """
    coverage = config.lag_coverage if after_gap else config.relocalisation_coverage
    is_backed = (
        np.isfinite(alignment.sdf_inlier_ratio)
        or alignment.surface_coverage > config.relocalisation_coverage
    )
    return (is_backed and quality(alignment) >= config.min_inlier_ratio) or (
        (config.surface_weight > 0 or config.photometric_pixels > 0)
        and _fits_surface(alignment, coverage, config)
        and _fits_image(alignment, config)
    )


def _fits_surface(alignment: Alignment, coverage: float, config: TrackerConfig) -> bool:
    return config.surface_weight == 0 or (
        alignment.surface_coverage > coverage
        and alignment.surface_inlier_ratio > config.reference_surface_agreement
    )


def _fits_image(alignment: Alignment, config: TrackerConfig) -> bool:
    agreement = alignment.photometric_inlier_ratio
    return config.photometric_pixels == 0 or agreement > config.reference_image_agreement


_EXPECTED_M, _EXPECTED_RAD = 0.05, 0.05  # from the prediction
_OVERLAP, _CONSISTENCY, _SIMILARITY = 0.25, 0.9, 0.8
_SIMILARITY_AFTER_GAP = 0.9  # without a prediction; poses 10 to 14 cm off reached 0.81 to 0.89


def is_confirmed(
    T_world_cam: np.ndarray, prediction: np.ndarray | None, frame: Frame, last: TrackedFrame,
    T_world_last: np.ndarray, longest_gap_s: float,
) -> bool:  # fmt: skip
    """Whether the pose [4, 4] is near the prediction, or else the whole image agrees with the last good one.

    If a camera was carried or there was a gap, surfaces may fit the map at a pose that is a few centimetres
    wrong; the images then contradict each other. `prediction` None: there is no reliable one. Images without
    contrast, as in the dark, do not count: the pose must then be near that of the last good frame, which
    must be at most `longest_gap_s` old.
    """
    if prediction is not None and _is_near(T_world_cam, prediction):
        return True
    least = _SIMILARITY_AFTER_GAP if prediction is None else _SIMILARITY
    agreement = dense_agreement(last.frame, frame, inverse(T_world_last) @ T_world_cam)
    if agreement.overlap < _OVERLAP or agreement.consistency < _CONSISTENCY:
        return False
    if np.isnan(agreement.similarity):
        gap_s = 1e-9 * abs(frame.stamp_ns - last.frame.stamp_ns)
        return gap_s <= longest_gap_s and _is_near(T_world_cam, T_world_last)
    return agreement.similarity >= least


def _is_near(T_world_cam: np.ndarray, prediction: np.ndarray) -> bool:
    step = inverse(prediction) @ T_world_cam
    turn_rad = np.linalg.norm(so3_log(step[:3, :3]))
    return bool(np.linalg.norm(step[:3, 3]) < _EXPECTED_M and turn_rad < _EXPECTED_RAD)


_THIN_COVERAGE = 0.45  # of a frame's points; less is little, as with a person before the camera
_LESS = 0.85  # of the largest coverage so far


def needs_replacing(
    alignment: Alignment, overlap: float, most_covered: float, config: TrackerConfig
) -> bool:
    """Whether the reference keyframe shows too little of the frame, or disagrees with it.

    Args:
        overlap: `reference_overlap` of the frame.
        most_covered: largest surface coverage of a frame since the keyframe became the reference.
    """
    return (
        overlap < config.reference_overlap
        or is_left_behind(alignment, most_covered, config)
        or alignment.surface_inlier_ratio < config.reference_surface_agreement
        or alignment.photometric_inlier_ratio < config.reference_image_agreement
    )


def is_left_behind(alignment: Alignment, most_covered: float, config: TrackerConfig) -> bool:
    """Whether much less of the frame meets the reference's surface than of earlier frames."""
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
