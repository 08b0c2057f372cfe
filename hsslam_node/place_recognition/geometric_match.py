"""The relative pose of a camera and a keyframe, by features that both show."""

from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import project
from hsslam_node.geometry.se3 import inverse
from hsslam_node.place_recognition.image_features import ImageFeatures, similarities

FEWEST_INLIERS = 10
_RATIO = 0.85  # of the distances of the nearest and the second nearest descriptor
_REPROJECTION_PX = 4.0  # at 640 px width
_ITERATIONS = 400
_DEPTH_SIGMA_M, _DEPTH_SIGMA_SLOPE = 0.01, 0.003  # of a feature's point at z: first + second z^2, m
_SIGMAS = 3.0


@dataclass(frozen=True)
class GeometricMatch:
    """A relative pose with the features that agree on it."""

    T_keyframe_cam: np.ndarray  # [4, 4]
    inliers: np.ndarray  # [n, 2] int, rows of the camera's and of the keyframe's features
    matches: int  # pairs of features that were tried


def geometric_match(
    cam: ImageFeatures, keyframe: ImageFeatures, camera: Camera
) -> GeometricMatch | None:
    """P3P in RANSAC over mutual nearest descriptors; None if too few features agree.

    A feature agrees if the keyframe's point meets its pixel and its depth. OpenCV's RANSAC draws the
    same samples in every call.
    """
    pairs = mutual_matches(cam, keyframe)
    return agreeing_pose(cam, keyframe, pairs, camera)


def mutual_matches(first: ImageFeatures, second: ImageFeatures) -> np.ndarray:
    """Rows [m, 2] of features that are each other's nearest and much nearer than the second nearest."""
    if len(first) < 2 or len(second) < 2:
        return np.empty((0, 2), int)
    similarity = similarities(first, second)
    rows = np.arange(len(first))
    nearest = similarity.argmax(axis=1)
    best = similarity[rows, nearest]
    is_mutual = similarity.argmax(axis=0)[nearest] == rows
    similarity[rows, nearest] = -1.0
    second_best = similarity.max(axis=1)
    # squared distances of unit vectors
    distance, other = 1.0 - best, 1.0 - second_best
    keep = is_mutual & (distance < _RATIO**2 * other)
    return np.stack([rows[keep], nearest[keep]], axis=-1)


def agreeing_pose(
    cam: ImageFeatures, keyframe: ImageFeatures, pairs: np.ndarray, camera: Camera
) -> GeometricMatch | None:
    """The pose that most of the `pairs` [m, 2] of features agree on."""
    if len(pairs) < FEWEST_INLIERS:
        return None
    points = keyframe.points[pairs[:, 1]]
    pixels = cam.pixels[pairs[:, 0]]
    tolerance_px = _REPROJECTION_PX * max(camera.width_px, 160) / 640
    found, rotation, translation, agreeing = cv2.solvePnPRansac(
        points, pixels, camera.K, None, iterationsCount=_ITERATIONS,
        reprojectionError=tolerance_px, confidence=0.9999, flags=cv2.SOLVEPNP_P3P,
    )  # fmt: skip
    if not found or agreeing is None or len(agreeing) < FEWEST_INLIERS:
        return None
    rows = np.asarray(agreeing, int)[:, 0]
    rotation, translation = cv2.solvePnPRefineLM(
        points[rows], pixels[rows], camera.K, None, rotation, translation
    )
    T_cam_keyframe = np.eye(4)
    T_cam_keyframe[:3, :3] = cv2.Rodrigues(rotation)[0]
    T_cam_keyframe[:3, 3] = translation[:, 0]
    if not np.isfinite(T_cam_keyframe).all():
        return None
    agree = _agrees(T_cam_keyframe, points, cam.points[pairs[:, 0]], pixels, camera, tolerance_px)
    if agree.sum() < FEWEST_INLIERS:
        return None
    return GeometricMatch(inverse(T_cam_keyframe), pairs[agree], len(pairs))


def _agrees(
    T_cam_keyframe: np.ndarray,
    points: np.ndarray,
    seen: np.ndarray,
    pixels: np.ndarray,
    camera: Camera,
    tolerance_px: float,
) -> np.ndarray:
    """Which of the keyframe's points [m, 3] lie at the pixels [m, 2] and at the depth of `seen` [m, 3]."""
    u, v, z = project(points, camera, T_cam_keyframe)
    near = np.hypot(u - pixels[:, 0], v - pixels[:, 1]) < tolerance_px
    tolerance_m = _SIGMAS * (_DEPTH_SIGMA_M + _DEPTH_SIGMA_SLOPE * z**2)
    return (z > 0.1) & near & (np.abs(z - seen[:, 2]) < tolerance_m)
