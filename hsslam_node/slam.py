"""The whole algorithm in one process, one frame at a time: for libraries, experiments and tests.

The service runs the same parts in separate processes; in lockstep it does the same steps in the same
order, so the poses are the same.
"""

import math
from collections.abc import Iterable, Iterator
from copy import deepcopy
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hsslam_node.bundle_adjustment.adjustment import BundleAdjustment
from hsslam_node.bundle_adjustment.open_adjustment import open_adjustment
from hsslam_node.config import SlamConfig
from hsslam_node.config.tracking import NEW_MAP_AFTER_S
from hsslam_node.dense_map.answers import MapAnswers, RayHits
from hsslam_node.dense_map.dense_map import DenseMap
from hsslam_node.dense_map.growing_map import GrowingMap
from hsslam_node.dense_map.shapes import Shapes
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.device.choose_device import DeviceChoice, choose_device
from hsslam_node.device.device import CPU, Device
from hsslam_node.errors import UserError
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.fragment_map import fragment_map
from hsslam_node.fragments.fragment_name import fragment_map_name, newest_fragment_map
from hsslam_node.fragments.fragment_tracker import open_fragment_tracker
from hsslam_node.frame import Frame, expect_trackable
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.allocator import ArrayAllocator, MemoryAllocator
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_node.map.epoch_poses import final_trajectory
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.pose_log import PoseLog
from hsslam_node.map.restore import restore_map
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import initial_bound
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.smooth_path import SmoothPath
from hsslam_node.sources.source import BadFrame
from hsslam_node.tracking.map_view import MapViews
from hsslam_node.tracking.open_tracker import FrameTracker
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult

if TYPE_CHECKING:
    from trimesh import Trimesh


class Slam:
    """Tracks and maps frames in lockstep; answers the queries of `SavedMap` from the map so far.

    Queries raise `UserError` if there is no map yet. `bad_frames`: frames that `run` skipped.

    Runs with the same frames, configuration and seed give the same bits if the kernels are in the cache
    (`hsslam-serve warm-up`): those that a process compiles itself round differently.

    Examples:
        >>> slam = Slam(PRESETS["realtime"], seed=0)
        >>> for result in slam.run(open_source("synth:room", SourceOptions()).frames()):
        ...     print(result.frame_index, result.T_world_cam[:3, 3])
        >>> slam.mesh().export("room.ply")
        >>> distance_m, gradient, known, certainty = slam.query([[0.5, 0.0, 2.0]])
    """

    def __init__(
        self,
        config: SlamConfig,
        seed: int = 0,
        arrays: ArrayAllocator | None = None,
        device: Device | DeviceChoice = CPU,
        *,
        saved_map: Path | str | None = None,
        localise_only: bool = False,
        new_map_after_s: float = NEW_MAP_AFTER_S,
        fragments: Path | str | None = None,
    ) -> None:
        """`saved_map`: continue this map, from anywhere in it; `localise_only`: do not change it.

        `new_map_after_s`: if the camera is lost for this time, it starts another map, a fragment, which
        joins the first map where they overlap; 0: never. One that ends without a join is saved for
        `hsslam-map merge`: map_fragment_1.safetensors and so on in the folder `fragments`, beside those that
        are there; None: it is lost. If one cannot be saved, the run goes on, and `finish` raises.

        Raises:
            UserError: the saved map (see `restore_map`) or the device cannot be used, `localise_only` has no
                saved map, or a number is out of range.
        """
        if not isinstance(config, SlamConfig):
            raise UserError(
                f"config = {config!r}: expected a SlamConfig, as PRESETS['realtime'] is"
            )
        is_number = isinstance(new_map_after_s, int | float | np.number)
        if not (is_number and 0 <= new_map_after_s < math.inf):
            raise UserError(f"new_map_after_s = {new_map_after_s!r}: expected seconds, 0 or more")
        if not isinstance(seed, Integral) or isinstance(seed, bool) or seed < 0:
            raise UserError(f"seed = {seed}: expected a whole number, 0 or more")
        self.config = config
        self.localise_only = localise_only
        self.seed = int(seed)
        self._new_map_after_s = new_map_after_s
        self._fragments = None if fragments is None else _made(Path(fragments))
        self._unsaved: list[str] = []  # why fragments are not saved
        self._device = device if isinstance(device, Device) else choose_device(device)
        self._arrays = arrays or MemoryAllocator()
        self.store: KeyframeStore | None = None
        self.parameters: FieldParameters | None = None
        self._tracker: FrameTracker | None = None
        self._mapper: Mapper | None = None
        self._ba: BundleAdjustment | None = None
        self._views: MapViews | None = None
        self.bad_frames: list[BadFrame] = []
        self.pose_log = PoseLog(MemoryAllocator())  # of this process alone
        self._path = SmoothPath(self.pose_log, config.tracker.longest_gap_s)
        self._maps = GrowingMap(config, self._device)
        if saved_map is not None:
            self.store, self.parameters = restore_map(self._arrays, Path(saved_map), config)
            self._attach(self.parameters)
            self._tracker = self._open_tracker(self.store)
            self._tracker.resume(anywhere=True)
        elif localise_only:
            raise UserError("localise_only: expected a saved map")

    def run(self, frames: Iterable[Frame | BadFrame]) -> Iterator[TrackResult]:
        """Process the frames and yield a result for each; unreadable ones go to `bad_frames`."""
        for frame in frames:
            if isinstance(frame, BadFrame):
                self.bad_frames.append(frame)
            else:
                yield self.process(frame)

    def finish(self) -> None:
        """Run the last iterations, after the last frame; a fragment that can join the map joins first.

        If the run continues a saved map, its keyframes that show only what this map shows retire before the
        iterations: mesh, queries and the saved map come from those that stay.

        Raises:
            UserError: fragments could not be saved; the map is finished nevertheless.
        """
        before = self.store.count if self.store else 0
        if self._tracker is not None and (joined := self._tracker.finish()) is not None:
            self.pose_log.join(joined.fragment)
            if self._ba and self.store and self._ba.has_joined(self.store):
                self._adjust(self._ba, self.store)
            self._map_new(before)
        if self._mapper and self.store and self.parameters and not self.localise_only:
            while self._mapper.select_last(self.store):
                pass
            n = self._mapper.last_iterations(self.store)
            for k in range(n):
                self._mapper.refine_sparse(self.store, k / n)
            self._mapper.publish()
        if self._unsaved:
            unsaved, self._unsaved[:] = "; ".join(self._unsaved), []
            raise UserError(unsaved)

    def process(self, frame: Frame) -> TrackResult:
        """Track one frame, then map: many iterations after the first, a few after each keyframe.

        Its images are copied, so a camera may write the next ones into the same arrays.

        Raises:
            UserError: it is no `Frame`, or not like the frames before.
        """
        if not isinstance(frame, Frame):
            raise UserError(f"frame is a {type(frame).__name__}: expected a Frame")
        result = self._process(frame.copied())
        at_ns = frame.stamp_ns
        row = result.log_row(source_stamp_ns=at_ns, stamp_ns=at_ns, publish_ns=at_ns)
        self._path.add(row, self.store, result.T_expected, is_carried=result.is_carried)
        self.pose_log.append(row)
        if (joined := result.joined) is not None:
            self.pose_log.join(joined.fragment)
        return deepcopy(result)  # the tracker goes on from some of its arrays

    @property
    def map(self) -> DenseMap:
        """A snapshot of the map; later frames do not change its answers.

        This reads the depth of new keyframes, 40 ms each. If keyframes are retired later, the mesh of this
        map lacks the surfaces that only they saw.
        """
        return self._maps.held(self.store, self.parameters)

    def query(self, points: ArrayLike) -> MapAnswers:
        """Distance, gradient, known and certainty at points [N, 3] m; see `DenseMap.query`."""
        return self._newest_map().query(points)

    def raycast(self, origins: ArrayLike, directions: ArrayLike, max_m: float = 10.0) -> RayHits:
        """How far rays [N, 3] meet no surface; see `DenseMap.raycast`."""
        return self._newest_map().raycast(origins, directions, max_m)

    def is_free(self, shapes: Shapes) -> np.ndarray:
        """Mask [N] of the spheres or boxes that fit; see `DenseMap.is_free`."""
        return self._newest_map().is_free(shapes)

    def render(
        self,
        T_world_cam: ArrayLike,
        camera: Camera | None = None,
        *,
        from_keyframes: bool = True,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Colour and depth as seen from T_world_cam [4, 4]; see `DenseMap.render`."""
        return self._newest_map().render(T_world_cam, camera, from_keyframes=from_keyframes)

    def mesh(self, voxel_m: float = 0.02, *, everywhere: bool = False) -> "Trimesh":
        """The coloured mesh of what the keyframes saw, or of everything; see `DenseMap.mesh`."""
        return self._newest_map().mesh(voxel_m, everywhere=everywhere)

    def trajectory(self) -> Trajectory:
        """The poses of all frames but lost ones, each corrected with its keyframe."""
        keyframe_poses = np.zeros((0, 4, 4)) if self.store is None else self.store.poses()
        rows = self.pose_log.joined(self.pose_log.rows())
        return final_trajectory(rows, keyframe_poses)

    def save(self, path: Path | str) -> None:
        """Write the map to a file for `SavedMap.open` and `saved_map`.

        Raises:
            UserError: there is no map yet, or the file cannot be written.
        """
        checkpoint = map_snapshot(self.store, self.parameters, self.config)
        save_checkpoint(Path(path), checkpoint)

    def _newest_map(self) -> DenseMap:
        return self._maps.newest(self.store, self.parameters)

    def _process(self, frame: Frame) -> TrackResult:
        if self._tracker is None:
            expect_trackable(frame.camera)
            self.store = KeyframeStore.create(
                self._arrays, frame.camera, frame.depth_units_per_m, self.config.keyframes.capacity
            )
            self._tracker = self._open_tracker(self.store)
        assert self.store
        before = self.store.count
        view = self._views.newest() if self._views else None
        result = self._tracker.track(frame, view, localise_only=self.localise_only)
        if result.status == "initial":
            self._open_map(frame)
        if self.parameters is None or self._mapper is None:
            return result
        if result.status == "initial":
            for _ in range(self.config.mapper.first_iterations):
                self._mapper.initialise(self.store)
            self._mapper.publish()
        elif result.is_keyframe or result.joined:
            self._map_new(before)
            if self._ba and self._ba.is_due(self.store):
                self._adjust(self._ba, self.store)
        elif self.store.room.is_short():  # for a fragment
            self._mapper.select(self.store)
        return result

    def _map_new(self, before: int) -> None:
        """Run the iterations of the keyframes from number `before` on."""
        if self._mapper and self.store:
            for _ in range(self.store.count - before):
                self._map_keyframe(self._mapper, self.store)

    def _map_keyframe(self, mapper: Mapper, store: KeyframeStore) -> None:
        """Run the iterations of one keyframe."""
        mapper.grow_bound(store)
        for _ in range(self.config.mapper.iterations):
            mapper.iterate(store)
        mapper.publish()
        if refined := mapper.take_poses(store):
            store.correct_poses(*refined)
        mapper.select(store)

    def _adjust(self, ba: BundleAdjustment, store: KeyframeStore) -> None:
        """One round of bundle adjustment."""
        report = ba.round(store)
        if report.moved:
            store.correct_poses(report.keyframes, report.T_world_cam, report.known, report.T_then)

    def _open_tracker(self, store: KeyframeStore) -> FrameTracker:
        return open_fragment_tracker(
            self.config, store, self.seed, self._device.threads, new_map_after_s=self._new_map_after_s,
            fragments=newest_fragment_map(self._fragments) if self._fragments else 0,
            keep=partial(_save_fragment, self._fragments, self.config, self._unsaved)
            if self._fragments else None, note_join=partial(_prepare_join, self.pose_log),
        )  # fmt: skip

    def _open_map(self, frame: Frame) -> None:
        c = self.config
        layout = FieldLayout.over(c.field, initial_bound(frame, c.bound, c.mapper.max_depth_m))
        self.parameters = FieldParameters.create(self._arrays, layout, self.seed)
        self._attach(self.parameters)

    def _attach(self, parameters: FieldParameters) -> None:
        c = self.config
        self._mapper = Mapper(c, parameters, self.seed, self._device)
        self._views = MapViews(parameters, self._device, with_color=c.tracker.method == "rendering")
        if c.ba.enabled:
            self._ba = open_adjustment(c, parameters, self.seed, self._device)


def _prepare_join(log: PoseLog, joined: JoinedFragment) -> None:
    log.prepare_join(joined.fragment, joined.keyframes, joined.T_keyframe_own)


def _save_fragment(
    folder: Path, config: SlamConfig, unsaved: list[str], fragment: Fragment
) -> None:
    """Save a fragment; if it cannot be saved, append the reason to `unsaved`."""
    try:
        save_checkpoint(folder / fragment_map_name(fragment.number), fragment_map(fragment, config))
    except UserError as error:
        unsaved.append(f"fragment {fragment.number} not saved: {error}")


def _made(folder: Path) -> Path:
    """The folder, made if it does not exist; UserError if it cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"fragments = {folder}: {error.strerror}: expected a folder") from None
    return folder
