"""The pose of a frame near a place that a person names: by features of keyframes there, else by depth."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.projection import camera_points
from hsslam_node.geometry.se3 import so3_exp, transformed
from hsslam_node.geometry.view_distance import TURN_M_PER_RAD, apart
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.place_recognition.keyframe_index import KeyframeIndex
from hsslam_node.place_recognition.picture_agreement import picture_agreement
from hsslam_node.tracking.aligned.acceptance import is_confirmed
from hsslam_node.tracking.alignment.align import align
from hsslam_node.tracking.find_loop import LoopLimits, LoopMatch, find_loop
from hsslam_node.tracking.keyframes.covering_keyframe import share_shown, stride_px
from hsslam_node.tracking.keyframes.reference_keyframe import grey_pyramid, stored_reference
from hsslam_node.tracking.tracked_frame import TrackedFrame, frame_points

NEAR_M, NEAR_RAD = 1.0, np.pi / 4  # from the place; a pose farther away is refused
# from the place; keyframes nearer than this may show what is seen there
_KEYFRAMES_M, _KEYFRAMES_RAD = 2.5, np.pi / 3
_TAKEN_IN = 4  # of these keyframes are indexed with a frame, 15 ms each
_ANYWHERE, _THERE = 2, 3  # keyframes compared in the whole map and near the place, 35 ms each
_CLEARLY = 2.0  # times the inliers: then a place elsewhere overrules the person
# the named place first
_SHIFTS_M = np.array([0.0, -0.25, 0.25, -0.5, 0.5])  # along each axis of the floor
_TURNS_RAD = np.deg2rad([0.0, -10.0, 10.0, -20.0, 20.0, -30.0, 30.0])
_LOOKED_AT = 6  # keyframes whose surfaces are compared with the frame's at all these poses
_ALIGNED = 4  # of these poses are aligned, 15 ms each


@dataclass(frozen=True)
class Whereabouts:
    """The approximate pose of the camera that a person names."""

    T_world_cam: np.ndarray  # [4, 4]
    up: np.ndarray  # [3] against gravity, world, unit length

    def has(self, T_world_cam: np.ndarray) -> bool:
        """Whether a camera at T_world_cam [4, 4] is near this place."""
        away_m, turn_rad = apart(self.T_world_cam, T_world_cam[None])
        return bool(away_m[0] <= NEAR_M and turn_rad[0] <= NEAR_RAD)

    def keyframes(self, store: KeyframeStore) -> np.ndarray:
        """Ids [n] of the kept keyframes that may show what is seen there, the nearest first."""
        ids = store.kept()
        away_m, turn_rad = apart(self.T_world_cam, store.poses_of(ids))
        order = np.argsort(away_m + TURN_M_PER_RAD * turn_rad, kind="stable")
        is_near = (away_m <= _KEYFRAMES_M) & (turn_rad <= _KEYFRAMES_RAD)
        return ids[order[is_near[order]]]


def place_near(
    store: KeyframeStore, index: KeyframeIndex, frame: Frame, near: Whereabouts,
    config: TrackerConfig, limits: LoopLimits, seed: int = 0,
) -> np.ndarray | None:  # fmt: skip
    """T_world_cam [4, 4] of the frame near the named place, or None.

    The named place decides between places that look alike, and if the frame has too few features. None if
    another place matches the frame clearly better, or if the images differ in detail.
    """
    keyframes = near.keyframes(store)
    if len(keyframes) == 0:
        return None
    index.take_in(keyframes, _TAKEN_IN)
    found = find_loop(store, index, frame, config, candidates=_ANYWHERE, limits=limits, seed=seed)
    there = _of_place(store, found, near)
    elsewhere = [m for m in found if m not in there]
    if not there:
        found = find_loop(
            store, index, frame, config,
            among=keyframes, candidates=_THERE, limits=limits, seed=seed,
        )  # fmt: skip
        there = _of_place(store, found, near)
    try:
        if not there:
            return None if elsewhere else _by_depth(store, frame, near, keyframes, config, seed)
        best = there[0]
        if elsewhere and elsewhere[0].inliers > _CLEARLY * best.inliers:
            return None
        if picture_agreement(store.frame(best.keyframe), frame, best.T_keyframe_cam).differ:
            return None
        return store.pose(best.keyframe) @ best.T_keyframe_cam
    except RetiredKeyframeError:  # meanwhile: the next frame finds another
        return None


def _of_place(store: KeyframeStore, found: list[LoopMatch], near: Whereabouts) -> list[LoopMatch]:
    return [m for m in found if near.has(store.pose(m.keyframe) @ m.T_keyframe_cam)]


def _by_depth(
    store: KeyframeStore, frame: Frame, near: Whereabouts, keyframes: np.ndarray,
    config: TrackerConfig, seed: int,
) -> np.ndarray | None:  # fmt: skip
    """T_world_cam [4, 4] of the frame by alignment from several start poses: the best fit that the whole
    images confirm, or None."""
    points, levels = frame_points(frame, config, seed), grey_pyramid(frame)
    if len(points) == 0:
        return None
    best, most = None, 0.0
    for T, k in _starts(store, frame, near, keyframes):
        reference, T_world_ref = stored_reference(store, k, config), store.pose(k)
        aligned = align(points, levels, T, None, reference, T_world_ref, config)
        found = aligned.T_world_cam
        if not (np.isfinite(found).all() and near.has(found)):
            continue
        keyframe = TrackedFrame(store.frame(k), k, np.eye(4))
        fits = aligned.surface_coverage * aligned.surface_inlier_ratio
        gap_s = config.longest_gap_s
        if fits > most and is_confirmed(found, None, frame, keyframe, T_world_ref, gap_s):
            best, most = found, fits
    return best


def _starts(
    store: KeyframeStore, frame: Frame, near: Whereabouts, keyframes: np.ndarray
) -> list[tuple[np.ndarray, int]]:
    """The start poses [4, 4] at which keyframes show most of the frame, each with the best keyframe."""
    poses = _poses_around(near)
    in_camera = camera_points(frame.depth_m(), frame.camera, stride_px(frame.camera))
    if len(in_camera) == 0:
        return []
    chosen = keyframes[:_LOOKED_AT].tolist()
    shown = np.array(
        [
            [share_shown(store, k, store.pose(k), transformed(T, in_camera)) for k in chosen]
            for T in poses
        ]
    )  # [poses, keyframes]
    order = np.argsort(-shown.max(axis=1), kind="stable")[:_ALIGNED]
    return [(poses[i], chosen[int(shown[i].argmax())]) for i in order]


def _poses_around(near: Whereabouts) -> list[np.ndarray]:
    """T_world_cam [4, 4] shifted along the floor and turned about the vertical, the named pose first."""
    side = np.cross(near.up, [1.0, 0, 0] if abs(near.up[0]) < 0.9 else [0, 1.0, 0])
    side /= np.linalg.norm(side)
    ahead = np.cross(side, near.up)
    poses = []
    for turn_rad in _TURNS_RAD:
        R = so3_exp(turn_rad * near.up)
        for along_m in _SHIFTS_M:
            for across_m in _SHIFTS_M:
                T = near.T_world_cam.copy()
                T[:3, :3] = R @ T[:3, :3]
                T[:3, 3] += along_m * ahead + across_m * side
                poses.append(T)
    return poses
