"""Opens the tracker that the configuration names; a file of its own, as neither tracker imports the other."""

from typing import Protocol

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.places.place_near import Whereabouts
from hsslam_node.tracking.rendering_tracker import RenderingTracker
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_node.tracking.tracker import Tracker
from hsslam_node.tracking.tracking_work import TrackingWork


class FrameTracker(Protocol):
    """One frame in, one pose with its quality out."""

    def resume(self, *, anywhere: bool = False) -> None:
        """Continue in an existing map, from its newest keyframe or, if `anywhere`, by relocalisation."""
        ...

    def track(
        self, frame: Frame, view: MapView | None, *, localise_only: bool = False
    ) -> TrackResult:
        """Return the pose of the frame; append a keyframe if one is due, unless `localise_only` is set."""
        ...

    def find_near(
        self, frame: Frame, view: MapView | None, near: Whereabouts, *, localise_only: bool = False
    ) -> TrackResult | None:
        """Return the pose of the frame near a place that a person names; None: not there, call `track`."""
        ...

    def limit_work(self, work: TrackingWork) -> None:
        """Do only this work for the next frames; a tracker that aligns to the map alone ignores it. If no
        keyframes are appended, `keyframes_every` counts between searches for a better reference."""
        ...

    def prepare_next(self) -> None:
        """Prepare for the next frame ahead of time; otherwise `track` does it."""
        ...

    def finish(self) -> JoinedFragment | None:
        """After the last frame: complete a join that has begun; returns the fragment that joined, if any."""
        ...


def open_tracker(
    config: SlamConfig, store: KeyframeStore, seed: int, threads: int = 1
) -> FrameTracker:
    """The tracker that `config.tracker.method` names; tracking by rendering uses up to `threads` threads."""
    if config.tracker.method == "rendering":
        return RenderingTracker(config, store, seed, threads=threads)
    return Tracker(config, store, seed)
