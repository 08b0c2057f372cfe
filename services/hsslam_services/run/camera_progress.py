"""Progress of the camera process, in the arena folder: a restarted camera continues from it."""

import struct
from dataclasses import dataclass, field
from pathlib import Path

from hsslam_proto.frame_order import new_publisher
from hsslam_services.run.run_info import write_atomically

_LAYOUT = struct.Struct("<qqqqqqqqqqq")
# counters of the camera, in its heartbeats
UNREAD = "unread frames"
SOURCE_FRAMES = "source_frames"  # that the run uses; missing if the source does not know


@dataclass
class CameraProgress:
    """Counts so far, and the times at which the sensor clock was tied to the monotonic clock (0: not yet).

    `publisher`: number of the camera; it stays the same after a restart of the camera.
    """

    next_index: int = 0
    sent: int = 0
    bad: int = 0
    pinned_source_ns: int = 0
    pinned_ns: int = 0
    publisher: int = field(default_factory=new_publisher)
    last_source_ns: int = -1  # stamp of the last frame that was sent; -1: none was
    skipped: int = 0  # late frames that were not read
    last_index: int = -1  # of the last frame that was sent; -1: none was
    skipped_by_wait: int = 0  # of those skipped, late because the source waited for a disk
    unread: int = 0  # of the bad ones, those that a failing disk or its network did not give

    def due_ns(self, source_ns: int, clock_scale: float) -> int:
        """Monotonic time at which the sensor would have delivered the frame of this source stamp.

        clock_scale: seconds of the sensor's clock per second of the source's stamps.
        """
        return self.pinned_ns + round((source_ns - self.pinned_source_ns) * clock_scale)

    def write(self, arena_dir: Path) -> None:
        """Write the file; in place if it exists, as that needs no memory, which may be full."""
        path, packed = _path(arena_dir), _LAYOUT.pack(*vars(self).values())
        try:
            with path.open("r+b", buffering=0) as file:
                file.write(packed)
        except FileNotFoundError:
            write_atomically(path, packed)

    @staticmethod
    def exists(arena_dir: Path) -> bool:
        """Whether a camera of this run may have sent a frame."""
        return _path(arena_dir).exists()

    @staticmethod
    def read(arena_dir: Path) -> "CameraProgress":
        """The progress of the earlier camera process; zeros if there was none."""
        path = _path(arena_dir)
        return (
            CameraProgress(*_LAYOUT.unpack(path.read_bytes()))
            if path.exists()
            else CameraProgress()
        )


def _path(arena_dir: Path) -> Path:
    return arena_dir / "camera_progress"
