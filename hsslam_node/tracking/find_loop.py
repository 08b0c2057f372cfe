"""Loop detection: keyframes that show the same place as a frame, with relative pose and evidence."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.place_recognition.dense_agreement import DenseAgreement, dense_agreement
from hsslam_node.place_recognition.geometric_match import GeometricMatch, geometric_match
from hsslam_node.place_recognition.image_features import ImageFeatures, image_features
from hsslam_node.place_recognition.keyframe_index import KeyframeIndex
from hsslam_node.tracking.alignment.align import align
from hsslam_node.tracking.keyframes.reference_keyframe import grey_pyramid, reference_keyframe
from hsslam_node.tracking.tracked_frame import frame_points


@dataclass(frozen=True)
class LoopLimits:
    """Thresholds that a relative pose must pass."""

    inliers: int = 14  # features that agree
    inlier_ratio: float = 0.25  # of the matches
    overlap: float = 0.15  # of either frame's depth on the other's surface
    consistency: float = 0.95  # of what could be seen from both sides
    similarity: float = 0.5  # correlation of grey levels
    refined_shift_m: float = 0.1  # largest change of the pose by dense alignment
    refined_shift_rad: float = 0.1


@dataclass(frozen=True)
class LoopMatch:
    """A frame that shows the same place as a keyframe."""

    keyframe: int
    T_keyframe_cam: np.ndarray  # [4, 4], by dense alignment of the two frames, no map involved
    inliers: int  # features that agree
    residual_m: float  # median depth difference where the surfaces meet
    overlap: float  # share of the depth points that meet the other's surface, smaller of the two
    consistency: float  # agreeing over agreeing and contradicting depth, smaller of the two
    similarity: float  # correlation of grey levels, -1..1


def find_loop(
    store: KeyframeStore,
    index: KeyframeIndex,
    query: Frame | int,
    config: TrackerConfig,
    *,
    among: np.ndarray | None = None,
    candidates: int = 3,
    limits: LoopLimits = LoopLimits(),
    seed: int = 0,
) -> list[LoopMatch]:
    """Keyframes that show the same place as `query`, a frame or the id of a keyframe; best first.

    The keyframes of `index` that share most features are tried, at most `candidates` (about 35 ms
    each): features that agree on a pose, dense alignment, agreement of the whole images. A match
    passes all limits. The poses of the keyframes are not used.

    Args:
        among: ids [n] that may match, such as old keyframes; None: all but the query itself.
    """
    is_keyframe = isinstance(query, int | np.integer)
    try:
        frame = store.frame(int(query)) if is_keyframe else query
        features = index.features(int(query)) if is_keyframe else image_features(frame)
    except RetiredKeyframeError:
        return []
    matches = []
    for k, _ in index.similar(features, candidates + is_keyframe, among):
        if is_keyframe and k == query:
            continue
        try:
            match = match_keyframe(store, index, frame, features, k, config, limits, seed)
        except RetiredKeyframeError:  # meanwhile
            continue
        if match is not None:
            matches.append(match)
    return sorted(matches, key=lambda m: -m.inliers)


def match_keyframe(
    store: KeyframeStore,
    index: KeyframeIndex,
    frame: Frame,
    features: ImageFeatures,
    k: int,
    config: TrackerConfig,
    limits: LoopLimits,
    seed: int = 0,
) -> LoopMatch | None:
    """The match of a frame with keyframe k, or None if it does not pass the limits."""
    found = geometric_match(features, index.features(k), frame.camera)
    if found is None or not _has_support(found, limits):
        return None
    keyframe = store.frame(k)
    T = _refined(frame, keyframe, found.T_keyframe_cam, config, seed)
    if T is None or not _is_near(T, found.T_keyframe_cam, limits):
        return None
    agreement = dense_agreement(keyframe, frame, T)
    if not _agrees(agreement, limits):
        return None
    return LoopMatch(
        keyframe=k,
        T_keyframe_cam=T,
        inliers=len(found.inliers),
        residual_m=agreement.residual_m,
        overlap=agreement.overlap,
        consistency=agreement.consistency,
        similarity=agreement.similarity,
    )


def _has_support(match: GeometricMatch, limits: LoopLimits) -> bool:
    n = len(match.inliers)
    return n >= limits.inliers and n >= limits.inlier_ratio * match.matches


def _refined(
    frame: Frame, keyframe: Frame, T_keyframe_cam: np.ndarray, config: TrackerConfig, seed: int
) -> np.ndarray | None:
    """T_keyframe_cam [4, 4] by dense alignment to the keyframe's surface and image."""
    reference = reference_keyframe(0, keyframe, grey_pyramid(keyframe), config)
    points = frame_points(frame, config, seed, reference.averaging_limit)
    if len(points) == 0:
        return None
    aligned = align(points, grey_pyramid(frame), T_keyframe_cam, None, reference, np.eye(4), config)
    return aligned.T_world_cam if np.isfinite(aligned.T_world_cam).all() else None


def _is_near(T: np.ndarray, start: np.ndarray, limits: LoopLimits) -> bool:
    shift_m = float(np.linalg.norm(T[:3, 3] - start[:3, 3]))
    cosine = (np.trace(T[:3, :3].T @ start[:3, :3]) - 1.0) / 2.0
    shift_rad = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return shift_m < limits.refined_shift_m and shift_rad < limits.refined_shift_rad


def _agrees(agreement: DenseAgreement, limits: LoopLimits) -> bool:
    return (
        agreement.overlap >= limits.overlap
        and agreement.consistency >= limits.consistency
        and agreement.similarity >= limits.similarity
    )
