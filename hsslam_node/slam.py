"""The whole algorithm in one process, one frame at a time: for libraries, experiments and tests.

The service runs the same parts in separate processes; in lockstep it does the same steps in the same
order, so the poses are the same.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

from hsslam_node.bundle_adjustment.open_adjustment import open_adjustment
from hsslam_node.bundle_adjustment.report import BundleAdjustment
from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.map.allocator import ArrayAllocator, MemoryAllocator
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.restore import restore_map
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import initial_bound
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.tracking.map_view import MapView, MapViews
from hsslam_node.tracking.open_tracker import FrameTracker, open_tracker
from hsslam_node.tracking.tracked_frame import TrackResult


class Slam:
    """Tracks and maps frames in lockstep.

    Examples:
        >>> slam = Slam(PRESETS["realtime"], seed=0)
        >>> for result in slam.run(open_source("synth:room", SourceOptions()).frames()):
        ...     print(result.frame_index, result.T_world_cam[:3, 3])
    """

    def __init__(
        self,
        config: SlamConfig,
        seed: int = 0,
        arrays: ArrayAllocator | None = None,
        device: Device = CPU,
        *,
        saved_map: Path | None = None,
        localise_only: bool = False,
    ) -> None:
        """`saved_map`: go on in it, wherever the camera is; with `localise_only` it stays as it is.

        Raises:
            UserError: the map cannot be used (`restore_map`), or there is none to localise in.
        """
        self.config = config
        self.localise_only = localise_only
        self.seed = seed
        self._device = device
        self._arrays = arrays or MemoryAllocator()
        self.store: KeyframeStore | None = None
        self.parameters: FieldParameters | None = None
        self._tracker: FrameTracker | None = None
        self._mapper: Mapper | None = None
        self._ba: BundleAdjustment | None = None
        self._views: MapViews | None = None
        if saved_map is not None:
            self.store, self.parameters = restore_map(self._arrays, saved_map, config)
            self._attach(self.parameters)
            self._tracker = open_tracker(config, self.store, seed)
            self._tracker.resume(anywhere=True)
        elif localise_only:
            raise UserError("localise_only: expected a saved map")

    def run(self, frames: Iterable[Frame]) -> Iterator[TrackResult]:
        """Process all frames, yielding the pose of each."""
        for frame in frames:
            yield self.process(frame)

    def finish(self) -> None:
        """The last iterations, when no more frames come."""
        if self._mapper and self.store and self.parameters and not self.localise_only:
            for _ in range(self._mapper.last_iterations(self.store)):
                self._mapper.refine_sparse(self.store)
            self._mapper.publish()

    def process(self, frame: Frame) -> TrackResult:
        """Track one frame, then map: the initial iterations after the first, some per keyframe."""
        if self._tracker is None:
            self._tracker = self._open_tracker(frame)
        assert self.store
        result = self._tracker.track(frame, self._view(), localise_only=self.localise_only)
        if result.status == "initial":
            self._open_map(frame)
        if self.parameters is None or self._mapper is None:
            return result
        if result.status == "initial":
            for _ in range(self.config.mapper.first_iterations):
                self._mapper.initialise(self.store)
            self._mapper.publish()
        elif result.is_keyframe:
            self._mapper.grow_bound(self.store)
            for _ in range(self.config.mapper.iterations):
                self._mapper.iterate(self.store)
            self._mapper.publish()
            if refined := self._mapper.take_poses(self.store):
                self.store.correct_poses(*refined)
            self._mapper.select(self.store)
            if self._ba and self._ba.is_due(self.store):
                report = self._ba.round(self.store)
                if report.moved:
                    self.store.correct_poses(report.keyframes, report.T_world_cam, report.known)
        return result

    def _open_tracker(self, frame: Frame) -> FrameTracker:
        self.store = KeyframeStore.create(
            self._arrays, frame.camera, frame.depth_units_per_m, self.config.keyframes.capacity
        )
        return open_tracker(self.config, self.store, self.seed)

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

    def _view(self) -> MapView | None:
        if self._views is None:
            return None
        return self._views.newest()
