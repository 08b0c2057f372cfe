"""Dense alignment of keyframes to each other, without the map, for the edges of the pose graph."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from hsslam_node.bundle_adjustment.pose_graph import PoseEdge
from hsslam_node.config import PoseGraphConfig, TrackerConfig
from hsslam_node.geometry.se3 import inverse, se3_log, skew
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.tracking.alignment.align import Alignment, align
from hsslam_node.tracking.keyframes.reference_keyframe import (
    PyramidLevel,
    ReferenceKeyframe,
    grey_pyramid,
    reference_keyframe,
)
from hsslam_node.tracking.tracked_frame import frame_points

_FINE_LEVELS = 2  # of the image pyramid, if the first guess is good
_INDEPENDENT = 0.1  # share of points and pixels whose errors are independent
_UNKNOWN_COVERAGE = 0.25  # assumed without the surface term
_MOST_PYRAMIDS = 16  # in the cache; a third of the lookups miss
_PYRAMID_BYTES = 0.1e9  # of two or more: 3 MB each at 640 x 480, 83 MB at 3840 x 2160
_PER_PIXELS = 2  # memory of a pyramid, relative to the images of a keyframe
_HELD_REFERENCES = 2  # 7 MB each; a round aligns many keyframes to one, then to the next
T = TypeVar("T")


class KeyframeAlignment:
    """Measures edges between keyframes of a store; caches the pyramids and references used last."""

    def __init__(
        self, store: KeyframeStore, tracker: TrackerConfig, config: PoseGraphConfig, seed: int
    ) -> None:
        self._store = store
        self._tracker = tracker
        self._config = config
        self._seed = seed
        fitting = int(_PYRAMID_BYTES) // (_PER_PIXELS * store.pixel_bytes)
        self.most_pyramids = min(max(fitting, 2), _MOST_PYRAMIDS)
        self._levels: OrderedDict[int, tuple[PyramidLevel, ...]] = OrderedDict()
        self._references: OrderedDict[int, ReferenceKeyframe] = OrderedDict()

    def neighbour(self, first: int, second: int, T_first_second: np.ndarray) -> PoseEdge | None:
        """Edge between keyframes whose relative pose is known well; None if they do not fit."""
        c = self._config
        found = self._aligned(first, second, T_first_second, _FINE_LEVELS)
        return self._edge(first, second, found, c.min_image_agreement)

    def loop(self, first: int, second: int, T_first_second: np.ndarray) -> PoseEdge | None:
        """Edge between keyframes that may see the same place: all levels, and more pixels must agree."""
        found = self._aligned(first, second, T_first_second, None)
        return self._edge(first, second, found, self._config.min_loop_image_agreement)

    def _aligned(
        self, first: int, second: int, T_first_second: np.ndarray, fine_levels: int | None
    ) -> Alignment | None:
        """Align the older keyframe to the newer one, whose reference is cached.

        Returns None if the older one has no depth, or if one of them is retired.
        """
        try:
            reference = self._reference(second)
            frame = self._store.frame(first)
            points = frame_points(frame, self._tracker, self._seed, reference.averaging_limit)
            if len(points) == 0:
                return None
            levels = self._pyramid(first)
        except RetiredKeyframeError:
            return None
        if fine_levels:
            levels = levels[-fine_levels:]
            reference = replace(
                reference,
                points=reference.points[-fine_levels:],
                grey=reference.grey[-fine_levels:],
            )
        guess = inverse(T_first_second)
        return align(points, levels, guess, None, reference, np.eye(4), self._tracker)

    def _edge(
        self, first: int, second: int, found: Alignment | None, image_agreement: float
    ) -> PoseEdge | None:
        c = self._config
        if found is None or not np.isfinite(found.T_world_cam).all():
            return None
        # nan, of a term without data, must fail a comparison; a term that is off makes none
        fits: list[bool] = []
        if self._tracker.surface_weight > 0:
            fits.append(found.surface_coverage >= c.min_coverage)
            fits.append(found.surface_inlier_ratio >= c.min_surface_agreement)
        if self._tracker.photometric_pixels > 0:
            fits.append(found.photometric_inlier_ratio >= image_agreement)
        if not fits or not all(fits):
            return None
        T_second_first = found.T_world_cam
        information = _information(found, c)
        return PoseEdge(first, second, inverse(T_second_first), information, True)

    def _pyramid(self, k: int) -> tuple[PyramidLevel, ...]:
        most = self.most_pyramids
        return _cached(self._levels, most, k, lambda: grey_pyramid(self._store.frame(k)))

    def _reference(self, k: int) -> ReferenceKeyframe:
        return _cached(self._references, _HELD_REFERENCES, k, lambda: self._prepared(k))

    def _prepared(self, k: int) -> ReferenceKeyframe:
        # without other views: an edge measures a keyframe that may be one of them
        return reference_keyframe(k, self._store.frame(k), self._pyramid(k), self._tracker)


def _information(found: Alignment, config: PoseGraphConfig) -> np.ndarray:
    """Information [6, 6] of T_first_second exp(x): noise of points and pixels, plus an error that they
    share. `found.information` is about the first keyframe, moved about its camera in the second's axes."""
    T = found.T_world_cam  # second <- first
    coverage = found.surface_coverage or _UNKNOWN_COVERAGE
    common = coverage**-1.5 * np.repeat([config.sigma_m, config.sigma_rad], 3)
    # exp(-x) moves the first keyframe by (-(x_t + x_r x t), -x_r)
    by_twist = -np.eye(6)
    by_twist[:3, 3:] = skew(T[:3, 3])
    own = _INDEPENDENT * by_twist.T @ found.information @ by_twist
    own += 1e-6 * np.diag(common**-2)
    return np.linalg.inv(np.linalg.inv(own) + np.diag(common**2))


def difference(T: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """How far apart two transforms [4, 4] are, m and rad."""
    x = se3_log(inverse(T) @ other)
    return float(np.linalg.norm(x[:3])), float(np.linalg.norm(x[3:]))


def _cached(cache: OrderedDict[int, T], most: int, k: int, make: Callable[[], T]) -> T:
    if k not in cache:
        cache[k] = make()
        while len(cache) > most:
            cache.popitem(last=False)
    cache.move_to_end(k)
    return cache[k]
