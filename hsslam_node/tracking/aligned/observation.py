"""A frame prepared for tracking: image pyramid, depth points, and the map to align it to."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.config.tracking import FEWEST_POINTS
from hsslam_node.depth_noise import averaging_limit
from hsslam_node.frame import Frame
from hsslam_node.tracking.keyframes.reference_keyframe import PyramidLevel, grey_pyramid
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.tracked_frame import frame_points

_FEWEST_SHARE = 0.2  # of the points of a frame, if few are chosen


@dataclass(frozen=True)
class Observation:
    """One frame, prepared for its alignment."""

    frame: Frame
    levels: tuple[PyramidLevel, ...]  # coarse first
    points: np.ndarray  # [N, 3] float32 m, camera frame
    view: MapView | None  # None: there is no map, or it does not cover this place
    localise_only: bool  # the map does not grow
    fewest_points: int  # to align the frame, or to begin a map with it

    @classmethod
    def of(
        cls,
        frame: Frame,
        view: MapView | None,
        config: TrackerConfig,
        seed: int,
        *,
        localise_only: bool,
        averaging: float | None = None,
    ) -> "Observation":
        """Build the image pyramid and choose the depth points, as in `frame_points`; `seed` places them."""
        if averaging is None:
            averaging = averaging_limit(frame, config.depth_window_px)
        points = frame_points(frame, config, seed, averaging)
        denser = max(config.surface_points / config.points, 1.0) if averaging else 1.0
        fewest = round(min(FEWEST_POINTS, _FEWEST_SHARE * config.points) * denser)
        return cls(frame, grey_pyramid(frame), points, view, localise_only, fewest)

    @property
    def has_depth(self) -> bool:
        """Whether there are enough points to align the frame, or to begin a map with it."""
        return len(self.points) >= self.fewest_points

    @property
    def map_version(self) -> int:
        """Version of the map that the frame is aligned to; 0: none."""
        return self.view.version if self.view else 0
