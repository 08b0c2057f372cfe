"""The tracker that a configuration asks for; a file of its own because neither tracker knows the other."""

from typing import Protocol

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.places.place_near import Whereabouts
from hsslam_node.tracking.rendering_tracker import RenderingTracker
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_node.tracking.tracker import Tracker


class FrameTracker(Protocol):
    """One frame in, one pose with its quality out."""

    def resume(self, *, anywhere: bool = False) -> None:
        """In a map that is there: go on from the newest keyframe of the store, or find the place."""
        ...

    def track(
        self, frame: Frame, view: MapView | None, *, localise_only: bool = False
    ) -> TrackResult:
        """Pose of the frame; a keyframe is appended to the store where one is due and wanted."""
        ...

    def find_near(
        self, frame: Frame, view: MapView | None, near: Whereabouts, *, localise_only: bool = False
    ) -> TrackResult | None:
        """Pose of the frame near a place that a person names; None if it is not there: track it."""
        ...

    def prepare_next(self) -> None:
        """What can be done before the next frame comes; `track` does it if the caller does not call this."""
        ...

    def finish(self) -> JoinedFragment | None:
        """No frame comes any more: a fragment that joins the map with that, if any."""
        ...


def open_tracker(
    config: SlamConfig, store: KeyframeStore, seed: int, threads: int = 1
) -> FrameTracker:
    """A tracker by `config.tracker.method`; tracking by rendering computes with up to `threads` threads."""
    if config.tracker.method == "rendering":
        return RenderingTracker(config, store, seed, threads=threads)
    return Tracker(config, store, seed)
