"""Mapping: selects the keyframes of each iteration, and prefers some that a correction has moved."""

from collections.abc import Callable
from functools import cache

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.errors import OutOfMemoryError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.view_distance import surface_shifts_m
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import wanted_bound
from hsslam_node.mapping.keyframe_selection import KeyframeSelection
from hsslam_node.mapping.map_optimiser import StepReport
from hsslam_node.mapping.moved_keyframes import draw_moved
from hsslam_node.mapping.open_map_optimiser import open_map_optimiser
from hsslam_node.mapping.ray_need import RayNeed
from hsslam_node.mapping.window_poses import RefinedPoses, WindowPoses

_MOVED_FAR_M = 0.3  # of surfaces; smaller moves stay within the margin of the bound
_MOVED_AT_A_TIME = 16  # moved keyframes that one call checks against the bound, 5 ms each
_MOST_REFINED = 4  # times the kept keyframes: the most that `last_iterations` counts


class Mapper:
    """Iterates over a window: the two newest keyframes and random others (paper III-B)."""

    def __init__(
        self, config: SlamConfig, parameters: FieldParameters, seed: int, device: Device = CPU
    ) -> None:
        self._config = config.mapper
        self._optimiser = open_map_optimiser(config, parameters, config.mapper.rays, device)
        self._parameters = parameters
        self._seed = seed
        self._bound_config = config.bound
        self._may_grow = config.bound.grow and not config.bound.box
        self._need: RayNeed | None = None
        self._results: Callable[[], None] | None = None  # of the last step
        self._covered = 0  # keyframes that were checked against the bound
        self._covered_at: dict[int, np.ndarray] = {}  # their T_world_cam at the check
        self._covered_version = 0  # pose version of the check
        self._poses = WindowPoses(config.mapper.pose_rate)
        ba = config.ba
        self._notes_losses = ba.enabled and ba.batch_losses and ba.selection == "active"
        self._selection = KeyframeSelection(config.keyframes, config.mapper.max_depth_m)

    def initialise(self, store: KeyframeStore) -> StepReport:
        """One iteration on the first keyframe, at the raised rates."""
        keyframes = np.array([0])
        return self._step(store, keyframes, self._config.first_rate_factor, newest_first=False)

    def iterate(self, store: KeyframeStore, ray_share: float = 1.0) -> StepReport:
        """One iteration over a window of kept keyframes, with `ray_share` of the configured rays. Up to
        `moved_share` of the random keyframes are ones that have moved since they were mapped. If `pose_rate`
        is above 0, it also refines the poses of the window; see `take_poses`."""
        kept = store.kept()
        size = min(self._config.window_keyframes, len(kept))
        generator = self._generator(0)
        recent, older = kept[:-3:-1][:size], kept[:-2]
        others = generator.choice(len(older), size - 2, replace=False) if size > 2 else []
        poses = store.poses_of(older)
        wanted = int((size - 2) * self._config.moved_share)
        moved = draw_moved(store, older, poses, wanted, generator)
        others = list(dict.fromkeys([*moved, *older[others]]))[: max(size - 2, 0)]
        keyframes = np.array([*recent, *others], np.int64)
        free = self._poses.are_free(store)
        return self._step(store, keyframes, 1.0, newest_first=True, ray_share=ray_share, free=free)

    def take_poses(self, store: KeyframeStore) -> RefinedPoses | None:
        """The poses that iterations have refined since the last call, or None. The caller writes them to the
        store before others correct poses."""
        self._take_results()
        return self._poses.take(store)

    def refine_sparse(self, store: KeyframeStore, done: float = 0.0) -> StepReport:
        """One iteration that prefers surfaces with few observations; used after the last frame. `done`: share
        of these iterations so far, 0 to 1; the learning rates fall with it to `last_rate_factor`."""
        if self._need is None or not np.array_equal(self._need.ids, store.kept()):
            self._need = RayNeed(store, self._config.max_depth_m)
        keyframes = self._need.keyframes(self._config.window_keyframes, self._generator(0))
        newest_first = bool(keyframes[0] == self._need.ids[-1])
        factor = self._config.last_rate_factor**done
        return self._step(store, keyframes, factor, newest_first=newest_first, need=self._need)

    def last_iterations(self, store: KeyframeStore) -> int:
        """Number of calls of `refine_sparse`: `last_iterations` for each keyframe, retired ones included, up
        to four times the kept ones."""
        keyframes = min(store.count, _MOST_REFINED * len(store.kept()))
        return self._config.last_iterations * keyframes

    def select(self, store: KeyframeStore) -> int:
        """Retire redundant keyframes; returns how many."""
        return self._selection.select(store)

    def select_last(self, store: KeyframeStore) -> int:
        """Before the last iterations of a run that continues a saved map: retire keyframes that show only
        what this map shows, some in each call; returns how many are not compared yet."""
        return self._selection.select_last(store)

    def grow_bound(self, store: KeyframeStore) -> Bound | None:
        """Grow the map if new keyframes, or ones that a correction moved far, see beyond its bound. Returns
        the new bound, or None if the old one suffices.

        Raises:
            OutOfMemoryError: memory does not suffice. The map stays as it is and does not grow again.
        """
        bound = wanted = self._parameters.layout.bound
        if not self._may_grow:
            return None
        for k in self._take_uncovered(store):
            T_world_cam, depth_m = self._covered_at[k], store.frame(k).depth_m()
            wider = wanted_bound(
                wanted,
                depth_m,
                store.camera,
                T_world_cam,
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

    def _take_uncovered(self, store: KeyframeStore) -> list[int]:
        """Ids of the kept keyframes to check against the bound: new ones, and some that have moved far since
        they were checked."""
        count, kept = store.count, store.kept()
        new = kept[(kept >= self._covered) & (kept < count)].tolist()
        chosen = [*self._moved_far(store), *new]
        if chosen:
            at = self._covered_at | dict(zip(chosen, store.poses_of(np.array(chosen)), strict=True))
            self._covered_at = {k: at[k] for k in kept.tolist() if k in at}
        self._covered = count
        return [k for k in chosen if k in self._covered_at]

    def _moved_far(self, store: KeyframeStore) -> list[int]:
        """Some of the checked keyframes that a correction has moved far since."""
        version = store.pose_version
        if version == self._covered_version or not self._covered_at:
            return []
        ids, then = np.array(list(self._covered_at)), np.stack(list(self._covered_at.values()))
        moved = ids[surface_shifts_m(then, store.poses_of(ids)) > _MOVED_FAR_M]
        if len(moved) <= _MOVED_AT_A_TIME:
            self._covered_version = version
        return moved[:_MOVED_AT_A_TIME].tolist()

    def publish(self) -> int:
        """Publish the current map as the newest version; returns its number."""
        self._take_results()
        self._optimiser.push()
        return self._parameters.publish()

    def _step(
        self,
        store: KeyframeStore,
        keyframes: np.ndarray,
        factor: float,
        *,
        newest_first: bool,
        need: RayNeed | None = None,
        ray_share: float = 1.0,
        free: bool = False,
    ) -> StepReport:
        n = len(keyframes)
        rays = int(self._config.rays * ray_share)
        extra = int(rays * self._config.newest_share) if newest_first and n > 2 else 0
        counts = np.full(n, (rays - extra) // n)
        counts[:2] += extra // 2

        @cache
        def poses() -> np.ndarray:
            self._take_results()
            return self._poses.of(store, keyframes)

        def results() -> None:
            if free:
                self._poses.step(store, keyframes, poses(), report.pose_gradient)
            if self._notes_losses and need is None:  # `need` does not sample images evenly
                store.note_losses(keyframes, report.keyframe_loss)

        generator = self._generator(1)
        report = self._optimiser.step(
            store, keyframes, counts, poses, generator,
            rate_factor=factor, with_poses=free, need=need,
        )  # fmt: skip
        self._results = results
        if not self._optimiser.reports_late:
            self._take_results()
        return report

    def _take_results(self) -> None:
        """Move poses and note losses by the report of the last step, if this is still to be done."""
        results, self._results = self._results, None
        if results is not None:
            results()

    def _generator(self, stream: int) -> np.random.Generator:
        """It depends only on the step, so a restarted mapper continues with the same numbers."""
        return np.random.default_rng((self._seed, self._parameters.step, stream))
