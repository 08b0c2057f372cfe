"""Decides which frames tracker and recorder accept from the bus."""

from pathlib import Path

from hsslam_proto.frame_order import LARGEST_STEP, FrameOrder, Place
from hsslam_proto.messages import Frame
from hsslam_services.bus.subscription import Received, Subscription
from hsslam_services.run.camera_progress import CameraProgress


class FrameInlet:
    """Refuses frames of other cameras and frames with absurd indices; the topic counts them as rejected.

    If the run has a camera process, it writes its publisher number to `camera_arena`, and frames of all
    other publishers are refused. An external camera is identified by the number in its frames, else by
    that in their attachments. It may count on after ten absurd indices in a row (`FrameOrder`).
    """

    def __init__(
        self, frames: Subscription[Frame], order: FrameOrder, camera_arena: Path | None
    ) -> None:
        self._frames = frames
        self._order = order
        self._camera_arena = camera_arena
        self._camera = 0  # publisher number of the run's own camera; 0: not known yet

    def admit(self, received: Received[Frame]) -> Place | None:
        """The place of a frame in the sequence of its camera; None if the frame is refused."""
        frame, envelope = received.message, received.envelope
        publisher = frame.publisher or (envelope.publisher if envelope else 0)
        if self._camera_arena and not self._is_own(self._camera_arena, publisher):
            self._frames.refuse(f"frame {frame.index} of another publisher than the run's camera")
            return None
        place = self._order.place(publisher, frame.index, frame.stamp_ns)
        if place.kind == "absurd":
            self._order.refuse(place)
            self._frames.refuse(
                f"frame {frame.index}: expected at most {LARGEST_STEP} after the last of its camera"
            )
            return None
        return place

    def takes(self, received: Received[Frame]) -> bool:
        """Whether a frame is admitted; marks it as taken."""
        place = self.admit(received)
        if place is not None and place.kind == "new":
            self._order.take(place)
        return place is not None

    def _is_own(self, arena: Path, publisher: int) -> bool:
        """Whether the frame is of the run's camera, which writes its number before its first frame."""
        if not self._camera and CameraProgress.exists(arena):
            self._camera = CameraProgress.read(arena).publisher
        return publisher == self._camera
