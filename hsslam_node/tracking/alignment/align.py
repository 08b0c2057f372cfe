"""Gauss-Newton alignment of one frame: to the SDF map, to a keyframe's surface and to its image."""

import math
from dataclasses import dataclass, field

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.geometry.pose_covariance import Evidence
from hsslam_node.geometry.se3 import moved_about_camera
from hsslam_node.tracking.alignment.frame_terms import Exposure, FrameTerms
from hsslam_node.tracking.alignment.motion_prior import pose_information, with_motion_prior
from hsslam_node.tracking.keyframes.reference_keyframe import PyramidLevel, ReferenceKeyframe
from hsslam_node.tracking.map_view import MapView

_COARSE_STOP = 1e-3  # m, rad
_DAMPING = 1e-4
_JUDGED = 0.05  # share of queried points in the bound; with fewer the map does not count
_SAME_EXPOSURE = Exposure()


@dataclass(frozen=True)
class Alignment:
    """A pose with the evidence for it."""

    T_world_cam: np.ndarray  # [4, 4]
    iterations: int
    sdf_inlier_ratio: float  # inliers over points in the bound; nan without a map or with few there
    sdf_rms_m: float  # of the inliers; nan as the ratio
    surface_inlier_ratio: float  # nan without the term
    surface_coverage: float  # share of the points that met the keyframe's surface
    photometric_inlier_ratio: float  # nan without the term
    outside: int  # points outside the bound
    exposure: Exposure = _SAME_EXPOSURE
    information: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    """[6, 6] of a twist (m, rad) as in `moved_about_camera`, with gain and bias left free."""
    evidence: Evidence | None = None


def align(
    points: np.ndarray,
    levels: tuple[PyramidLevel, ...],
    T_world_cam: np.ndarray,
    view: MapView | None,
    reference: ReferenceKeyframe | None,
    T_world_ref: np.ndarray,
    config: TrackerConfig,
    exposure: Exposure = _SAME_EXPOSURE,
    doubt: np.ndarray | None = None,
) -> Alignment:
    """Align a frame, coarse to fine, starting from `T_world_cam` [4, 4].

    Args:
        points: [N, 3] float32 m, depth points in the camera frame; all of them are aligned to the
            keyframe's surface at the finest level, about `config.points` of them to the map.
        levels: image pyramid of the frame.
        view: the map; None before there is one.
        reference: the keyframe; None leaves its two terms out.
        T_world_ref: [4, 4] pose of the keyframe.
        exposure: the initial one.
        doubt: covariance [6, 6] of `T_world_cam` if odometry predicts it, as in `with_motion_prior`.
    """
    terms = FrameTerms(points, levels, view, reference, T_world_ref, config, exposure)
    T = T_world_cam.copy()
    iterations = 0
    system = None
    for level in range(len(levels)):
        fine = level == len(levels) - 1
        for _ in range(config.iterations):
            system = terms.linearise(T, level)
            H, b = system.H, system.b
            if fine:
                H, b = with_motion_prior(H, b, T, T_world_cam, config.weak_direction_m, doubt)
            x = np.linalg.solve(H + _DAMPING * np.diag(np.diag(H)), -b)
            T = moved_about_camera(T, x[:6])
            terms.exposure = Exposure(terms.exposure.bias + x[6], terms.exposure.gain + x[7])
            iterations += 1
            if np.abs(x[:6]).max() < (config.stop_step if fine else _COARSE_STOP):
                break
    assert system is not None
    nan = float("nan")
    is_judged = system.sdf_seen > _JUDGED * (system.sdf_seen + system.outside)
    return Alignment(
        T_world_cam=T,
        iterations=iterations,
        sdf_inlier_ratio=system.sdf_inliers / system.sdf_seen if is_judged else nan,
        sdf_rms_m=math.sqrt(system.sdf_squares / max(system.sdf_inliers, 1)) if is_judged else nan,
        surface_inlier_ratio=_ratio(system.surface_inliers, system.surface_met),
        surface_coverage=system.surface_met / max(len(points), 1),
        photometric_inlier_ratio=_ratio(system.photo_inliers, system.photo_seen),
        outside=system.outside,
        information=pose_information(system.H),
        evidence=system.evidence(),
        exposure=terms.exposure,
    )


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")
