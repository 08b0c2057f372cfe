"""A fragment: what a camera that is lost to the map sees, in a coordinate frame of its own; apart, as
tracking, search and joining need it."""

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.tracked_frame import TrackResult
from hsslam_node.tracking.tracker import Tracker


class Fragment:
    """Keyframes in memory of this process, and a tracker that aligns frames to them alone.

    No field is fitted to them, and no other process sees them before they join the map.
    """

    def __init__(self, config: SlamConfig, first: Frame, seed: int, number: int, most: int) -> None:
        """`most`: keyframes that it may have; then it is tracked on those that there are."""
        self.number = number
        self.store = KeyframeStore.create(
            MemoryAllocator(), first.camera, first.depth_units_per_m, most
        )
        self.tracker = Tracker(config, self.store, seed)

    def track(self, frame: Frame) -> TrackResult:
        """The pose in the fragment."""
        return self.tracker.track(frame, None)
