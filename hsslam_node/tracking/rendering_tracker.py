"""Tracking by rendering, as in the paper: descent on the rendering losses, then a check of the pose."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import SlamConfig, TrackerConfig
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_log
from hsslam_node.kernels.field.sdf_query import query_sdf
from hsslam_node.kernels.tracking.alignment import add_sdf_term
from hsslam_node.kernels.tracking.depth_points import transform_points
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import first_pose, may_begin_map
from hsslam_node.tracking.alignment.frame_terms import open_sdf_term
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.places.place_near import Whereabouts
from hsslam_node.tracking.rendering_objective import PoseObjective, RenderingObjective, descend
from hsslam_node.tracking.tracked_frame import (
    TrackedFrame,
    TrackResult,
    frame_points,
    orthonormal,
    predicted_pose,
)
from hsslam_node.tracking.tracking_work import TrackingWork


@dataclass(frozen=True)
class SurfaceFit:
    """How well depth points at a pose fit the map's surface."""

    inlier_ratio: float  # points within the Huber threshold of the surface over points in the bound
    rms_m: float  # distance of the inliers
    outside: int  # points outside the bound


def surface_fit(
    points: np.ndarray, T_world_cam: np.ndarray, view: MapView, config: TrackerConfig
) -> SurfaceFit:
    """The fit of points [N, 3] float32 (m, camera frame) at T_world_cam [4, 4] to the map's surface."""
    n = len(points)
    world = np.empty((n, 3), np.float32)
    H, b = np.zeros((8, 8)), np.zeros(8)
    if view.on_device is not None:  # `view.params` may be overwritten
        term = open_sdf_term(view, (points, points), config)
        inliers, seen, squares = term.add(T_world_cam, world, True, H, b)
        return _fit(n, inliers, seen, squares)
    sdf, inside = np.empty(n, np.float32), np.empty(n, np.uint8)
    gradient = np.zeros((n, 3), np.float32)
    transform_points(T_world_cam, points, world)
    query_sdf(view.params, view.layout, world, sdf, inside, gradient, False)
    _, inliers, seen, squares = add_sdf_term(
        sdf, gradient, inside, world, points[:, 2], T_world_cam[:3, 3].copy(), view.truncation_m,
        config.sdf_sigma_m, config.sdf_sigma_slope, config.sdf_huber_m,
        H, b,
    )  # fmt: skip
    return _fit(n, inliers, seen, squares)


def _fit(points: int, inliers: int, seen: int, squares_m2: float) -> SurfaceFit:
    rms_m = float(np.sqrt(squares_m2 / max(inliers, 1)))
    return SurfaceFit(inliers / max(seen, 1), rms_m, points - seen)


_FEWEST_POINTS = 100


class RenderingTracker:
    """Tracks frames by gradient descent on the rendering losses; a `FrameTracker`.

    Descent starts at the prediction, then at the last pose. A pose is accepted if enough depth points
    lie on the map's surface and the pose is near its start; otherwise the frame is lost. There is no
    relocalisation. After the first frame, frames are lost until there is a map.
    """

    def __init__(
        self,
        config: SlamConfig,
        store: KeyframeStore,
        seed: int,
        objective: PoseObjective | None = None,
        *,
        threads: int = 1,
    ) -> None:
        """`threads`: number of threads."""
        self._threads = threads
        self._slam = config
        self._config = config.tracker
        self._store = store
        self._seed = seed
        self._objective = objective
        self._last: TrackedFrame | None = None
        self._before_last: TrackedFrame | None = None
        self._since_keyframe = 0
        self._localise_only = False

    def resume(self, *, anywhere: bool = False) -> None:
        """Continue in an existing map from the newest keyframe of the store.

        Raises:
            UserError: `anywhere` is set, as there is no relocalisation.
        """
        if anywhere:
            raise UserError(
                "tracker.method = rendering: cannot relocalise in a saved map: expected alignment"
            )
        newest = self._store.count - 1
        self._last = TrackedFrame(self._store.frame(newest), newest, np.eye(4))
        self._before_last = None

    def track(
        self, frame: Frame, view: MapView | None, *, localise_only: bool = False
    ) -> TrackResult:
        """Return the pose of the frame; append a keyframe if one is due, unless `localise_only` is set.

        Raises:
            TornMapError: as in `Tracker`.
        """
        self._localise_only = localise_only
        self._store.expect_like(frame)
        points = frame_points(frame, self._config, self._seed)
        if self._last is None:
            return self._start(frame, len(points))
        T_last = self._last.pose(self._store)
        prediction = predicted_pose(self._last, self._before_last, self._store, frame.stamp_ns)
        if view is not None and len(points) >= _FEWEST_POINTS:
            objective = self._objective or self._open_objective(view)
            objective.observe(frame, view)
            for guess in (prediction, T_last):
                T = self._descended(objective, guess)
                fit = surface_fit(points, T, view, self._config)
                view.expect_intact()
                if self._is_good(fit, T, guess):
                    return self._accept(frame, orthonormal(T), fit, view.version)
        return self._lose(frame, prediction, view.version if view else 0)

    def _descended(self, objective: PoseObjective, T_world_cam: np.ndarray) -> np.ndarray:
        """The pose that descent from T_world_cam reaches, with more descents if the motion is not known."""
        config, is_motion_known = self._slam.rendering_tracker, self._before_last is not None
        for _ in range(1 if is_motion_known else config.first_descents):
            T_world_cam = descend(objective, T_world_cam, config)
        return T_world_cam

    def finish(self) -> None:
        """Do nothing: this tracker has no fragments."""

    def find_near(
        self, frame: Frame, view: MapView | None, near: Whereabouts, *, localise_only: bool = False
    ) -> TrackResult | None:
        """None: this tracker has no relocalisation."""

    def limit_work(self, work: TrackingWork) -> None:
        """Do nothing: this tracker aligns to the map alone, so the map must follow the camera."""

    def prepare_next(self) -> None:
        """Do nothing."""

    def _open_objective(self, view: MapView) -> PoseObjective:
        """The losses on the device that has the map."""
        if view.on_device is not None:
            from hsslam_node.tracking.gpu_rendering_objective import GpuRenderingObjective

            self._objective = GpuRenderingObjective(self._slam, self._seed, view)
        else:
            self._objective = RenderingObjective(self._slam, self._seed, self._threads)
        return self._objective

    def _start(self, frame: Frame, points: int) -> TrackResult:
        may_begin = may_begin_map(frame, self._slam.mapper.max_depth_m)
        if points < _FEWEST_POINTS or not may_begin or self._localise_only:
            return TrackResult.without_map(frame.index)
        T_world_cam = first_pose(self._slam.bound)
        with self._store.appending():
            k = self._store.append(frame, T_world_cam)
        self._last = TrackedFrame(frame, k, np.eye(4))
        return TrackResult.first(frame.index, k, T_world_cam)

    def _is_good(self, fit: SurfaceFit, T: np.ndarray, guess: np.ndarray) -> bool:
        step = se3_log(inverse(guess) @ T)
        return bool(
            fit.inlier_ratio >= self._config.min_inlier_ratio
            and np.linalg.norm(step[:3]) < self._config.max_step_m
            and np.linalg.norm(step[3:]) < self._config.max_step_rad
        )

    def _accept(self, frame: Frame, T: np.ndarray, fit: SurfaceFit, version: int) -> TrackResult:
        self._since_keyframe += 1
        is_due = self._since_keyframe >= self._slam.keyframes.every_frames
        is_keyframe = is_due and not self._localise_only and self._store.has_room()
        if is_keyframe:
            self._since_keyframe = 0
            with self._store.appending():
                k, T_keyframe_cam = self._store.append(frame, T), np.eye(4)
        else:
            k = self._store.count - 1
            T_keyframe_cam = inverse(self._store.pose(k)) @ T
        self._before_last = self._last
        self._last = TrackedFrame(frame, k, T_keyframe_cam)
        return TrackResult(
            frame_index=frame.index, status="tracked", T_world_cam=T, keyframe=k,
            T_keyframe_cam=T_keyframe_cam, quality=float(fit.inlier_ratio), residual_m=fit.rms_m,
            map_version=version, is_keyframe=is_keyframe, outside=fit.outside,
        )  # fmt: skip

    def _lose(self, frame: Frame, T: np.ndarray, version: int) -> TrackResult:
        assert self._last is not None
        k = self._last.keyframe
        T_keyframe_cam = inverse(self._store.pose(k)) @ T
        self._before_last = None
        return TrackResult(
            frame_index=frame.index, status="lost", T_world_cam=T, keyframe=k,
            T_keyframe_cam=T_keyframe_cam, map_version=version,
        )  # fmt: skip
