"""A fragment: keyframes of a camera that is lost to the map, in a coordinate frame of their own."""

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.keyframe_selection import KeyframeSelection
from hsslam_node.tracking.tracked_frame import TrackResult
from hsslam_node.tracking.tracker import Tracker

MOST_BYTES = 930_000_000  # of the pixels of one fragment: 600 keyframes at 640x480
_MOST_KEYFRAMES = 600
_NEARLY_FULL = 0.9  # of the keyframes that it may keep; above, keyframes are retired


def most_keyframes(pixel_bytes: int) -> int:
    """Keyframes that a fragment may keep, `pixel_bytes` each, in the memory of the tracker."""
    return min(_MOST_KEYFRAMES, MOST_BYTES // pixel_bytes)


class Fragment:
    """Keyframes in memory of this process, and a tracker that aligns frames to them alone.

    No field is fitted to them, and no other process sees them before they join the map.
    """

    def __init__(self, config: SlamConfig, first: Frame, seed: int, number: int, most: int) -> None:
        """`most`: keyframes that it keeps; when nearly full, it retires those that others show best."""
        self.number = number
        self.store = KeyframeStore.create(
            MemoryAllocator(), first.camera, first.depth_units_per_m, most
        )
        self.tracker = Tracker(config, self.store, seed)
        self._selection = KeyframeSelection(
            config.keyframes, config.mapper.max_depth_m, judges_all=True
        )

    @property
    def nbytes(self) -> int:
        """Memory of the pixels of its keyframes."""
        return len(self.store.kept()) * self.store.pixel_bytes

    def track(self, frame: Frame) -> TrackResult:
        """The pose in the fragment."""
        result = self.tracker.track(frame, None)
        if result.is_keyframe and len(self.store.kept()) > _NEARLY_FULL * self.store.room.most_kept:
            self._selection.select(self.store)
        return result
