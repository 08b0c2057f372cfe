"""Mapping: which keyframes an iteration looks at. Keyframes whose poses were corrected come first."""

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import wanted_bound
from hsslam_node.mapping.map_optimiser import StepReport
from hsslam_node.mapping.open_map_optimiser import open_map_optimiser
from hsslam_node.mapping.ray_need import RayNeed

_MOVED_M, _MOVED_RAD = 1e-3, 1e-3  # less is within what the map resolves
_REPEATS = 8  # draws until the map has followed a keyframe


class MovedKeyframes:
    """Notes where each keyframe stood when it was mapped."""

    def __init__(self) -> None:
        self._mapped_at = np.zeros((0, 4, 4))
        self._due = np.zeros(0, np.int64)  # draws that are outstanding

    def draw(self, poses: np.ndarray, wanted: int, generator: np.random.Generator) -> np.ndarray:
        """At most `wanted` ids of keyframes that have moved, given all poses [n, 4, 4] now."""
        self._follow(poses)
        moved = np.flatnonzero(self._due > 0)
        size = min(wanted, len(moved))
        if size <= 0:
            return np.zeros(0, np.int64)
        drawn = generator.choice(moved, size, replace=False)
        self._due[drawn] -= 1
        return drawn

    def _follow(self, poses: np.ndarray) -> None:
        known = len(self._mapped_at)
        then, now = self._mapped_at, poses[:known]
        shift_m = np.linalg.norm(now[:, :3, 3] - then[:, :3, 3], axis=1)
        # for small angles the matrices are sqrt(2) times the angle apart
        turn_rad = np.linalg.norm(now[:, :3, :3] - then[:, :3, :3], axis=(1, 2)) / np.sqrt(2)
        moved = (shift_m > _MOVED_M) | (turn_rad > _MOVED_RAD)
        self._due[moved] = _REPEATS
        then[moved] = now[moved]
        self._mapped_at = np.concatenate([then, poses[known:]])
        self._due = np.append(self._due, np.zeros(len(poses) - known, np.int64))


class Mapper:
    """Iterates over a window: the newest keyframe, the one before it, random others (paper III-B)."""

    def __init__(
        self, config: SlamConfig, parameters: FieldParameters, seed: int, device: Device = CPU
    ) -> None:
        self._config = config.mapper
        self._optimiser = open_map_optimiser(config, parameters, config.mapper.rays, device)
        self._parameters = parameters
        self._seed = seed
        self._bound_config = config.bound
        self._may_grow = config.bound.grow
        self._need: RayNeed | None = None
        self._covered = 0  # keyframes that the bound was held against
        self._moved = MovedKeyframes()

    def initialise(self, store: KeyframeStore) -> StepReport:
        """One iteration on the first keyframe, at the raised rates."""
        return self._step(store, np.array([0]), self._config.first_rate_factor)

    def iterate(self, store: KeyframeStore) -> StepReport:
        """One iteration over a window of the keyframes there are now; half of the others are such that
        have moved since they were mapped, while there are any."""
        newest = store.count - 1
        size = min(self._config.window_keyframes, store.count)
        generator = self._generator(0)
        recent = [newest] if size == 1 else [newest, newest - 1]
        others = generator.choice(newest - 1, size - 2, replace=False) if size > 2 else []
        moved = self._moved.draw(store.poses()[: max(newest - 1, 0)], (size - 2) // 2, generator)
        others = list(dict.fromkeys([*moved, *others]))[: max(size - 2, 0)]
        return self._step(store, np.array([*recent, *others], np.int64), 1.0)

    def polish(self, store: KeyframeStore) -> StepReport:
        """One iteration where surfaces were seldom seen as elsewhere, for when no more frames come."""
        if self._need is None or self._need.keyframe_count != store.count:
            self._need = RayNeed(store, self._config.max_depth_m)
        keyframes = self._need.keyframes(self._config.window_keyframes, self._generator(0))
        return self._step(store, keyframes, 1.0, need=self._need)

    def cover(self, store: KeyframeStore) -> Bound | None:
        """Grow the map where a new keyframe sees past its bound; the new bound, None where it fits.

        Raises:
            OutOfMemoryError: there is no room. The map stays as it was and grows no more.
        """
        bound = wanted = self._parameters.layout.bound
        first, self._covered = self._covered, store.count
        if not self._may_grow:
            return None
        poses = store.poses()
        for k in range(first, self._covered):
            depth_m = store.frame(k).depth_m()
            wider = wanted_bound(
                wanted,
                depth_m,
                store.camera,
                poses[k],
                self._bound_config,
                self._config.max_depth_m,
            )
            wanted = wider or wanted
        if wanted == bound:
            return None
        self._optimiser.push()
        try:
            self._parameters.grow(wanted, self._seed)
        except OutOfMemoryError:
            self._may_grow = False
            raise
        return self._parameters.layout.bound

    def publish(self) -> int:
        """Make the map as it is now the newest version; returns its number."""
        self._optimiser.push()
        return self._parameters.publish()

    def _step(
        self,
        store: KeyframeStore,
        keyframes: np.ndarray,
        factor: float,
        *,
        need: RayNeed | None = None,
    ) -> StepReport:
        n = len(keyframes)
        newest_first = keyframes[0] == store.count - 1
        extra = int(self._config.rays * self._config.newest_share) if newest_first and n > 2 else 0
        counts = np.full(n, (self._config.rays - extra) // n)
        counts[:2] += extra // 2
        poses = store.poses()[keyframes]
        generator = self._generator(1)
        return self._optimiser.step(
            store, keyframes, counts, poses, generator, rate_factor=factor, need=need
        )

    def _generator(self, stream: int) -> np.random.Generator:
        """Depends on the step alone, so a restarted mapper goes on with the same numbers."""
        return np.random.default_rng((self._seed, self._parameters.step, stream))
