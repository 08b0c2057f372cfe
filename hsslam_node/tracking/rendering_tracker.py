"""Tracking by rendering, as the paper and its parents do it."""

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, se3_log
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.frame_points import frame_points
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.pose_objective import PoseObjective
from hsslam_node.tracking.rendering_descent import descend
from hsslam_node.tracking.rendering_objective import RenderingObjective
from hsslam_node.tracking.surface_fit import SurfaceFit, surface_fit
from hsslam_node.tracking.track_result import TrackResult
from hsslam_node.tracking.tracked_frame import TrackedFrame, orthonormal, predicted_pose

_FEWEST_POINTS = 100


class RenderingTracker:
    """Tracks frames by descent of the rendering losses; the same seam as `Tracker`.

    A pose is published if enough depth points lie on the map's surface and it is near the
    prediction; else the last pose is tried as the start, and then the frame is lost. There is no
    search for a place seen before. Frames that come before there is a map are lost.
    """

    def __init__(
        self,
        config: SlamConfig,
        store: KeyframeStore,
        seed: int,
        objective: PoseObjective | None = None,
    ) -> None:
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
        """In a map that is there: go on from the newest keyframe of the store.

        Raises:
            UserError: `anywhere` is asked for, as the camera's place is not known.
        """
        if anywhere:
            raise UserError(
                "tracker.method = rendering: cannot find its place in a saved map: expected alignment"
            )
        newest = self._store.count - 1
        self._last = TrackedFrame(self._store.frame(newest), newest, np.eye(4))
        self._before_last = None

    def track(
        self, frame: Frame, view: MapView | None, *, localise_only: bool = False
    ) -> TrackResult:
        """Pose of the frame; a keyframe is appended to the store where one is due and wanted."""
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
                T = descend(objective, guess, self._slam.rendering_tracker)
                fit = surface_fit(points, T, view, self._config)
                if self._is_good(fit, T, guess):
                    return self._accept(frame, orthonormal(T), fit, view.version)
        return self._lose(frame, prediction, view.version if view else 0)

    def settle(self) -> None:
        """Nothing is left to do."""

    def _open_objective(self, view: MapView) -> PoseObjective:
        """The losses where the map is: on a GPU, or here."""
        if view.on_device is not None:
            from hsslam_node.tracking.gpu_rendering_objective import GpuRenderingObjective

            self._objective = GpuRenderingObjective(self._slam, self._seed, view)
        else:
            self._objective = RenderingObjective(self._slam, self._seed)
        return self._objective

    def _start(self, frame: Frame, points: int) -> TrackResult:
        nan = float("nan")
        if points < _FEWEST_POINTS or self._localise_only:  # nothing to start a map on
            return TrackResult(frame.index, "lost", np.eye(4), -1, np.eye(4), 0.0, nan, 0, False, 0)
        k = self._store.append(frame, np.eye(4))
        self._last = TrackedFrame(frame, k, np.eye(4))
        return TrackResult(frame.index, "initial", np.eye(4), k, np.eye(4), 1.0, nan, 0, True, 0)

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
        is_keyframe = is_due and not self._localise_only
        if is_keyframe:
            self._since_keyframe = 0
            k, T_keyframe_cam = self._store.append(frame, T), np.eye(4)
        else:
            k = self._store.count - 1
            T_keyframe_cam = inverse(self._store.pose(k)) @ T
        self._before_last = self._last
        self._last = TrackedFrame(frame, k, T_keyframe_cam)
        return TrackResult(
            frame.index, "tracked", T, k, T_keyframe_cam, float(fit.inlier_ratio), fit.rms_m,
            version, is_keyframe, fit.outside,
        )  # fmt: skip

    def _lose(self, frame: Frame, T: np.ndarray, version: int) -> TrackResult:
        assert self._last is not None
        k = self._last.keyframe
        T_keyframe_cam = inverse(self._store.pose(k)) @ T
        self._before_last = None
        nan = float("nan")
        return TrackResult(frame.index, "lost", T, k, T_keyframe_cam, 0.0, nan, version, False, 0)
