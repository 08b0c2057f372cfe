"""The sequences of the benchmark: folders of the data, built-in scenes, and recordings made of them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hsslam_bench.runs.room_recordings import write_distorted_room, write_recorded_room

QUICK_FRAMES = 40
RECORDED_ROOM = "recordedroom"  # synth:room as files, so that a run renders nothing
RoomCamera = Literal["plain", "lens"]
_LENS_FRAMES = 300
_HALF, _HALF_ROOM = ("--downscale", "2"), ("--synth.width-px", "320", "--synth.height-px", "240")
_SCENES = ("room", "apartment", "corridor", "person", "chair", "lookalike")
_SOURCES = {"livingroom": "tum", "kitchen": "tum", "house": "replica"}  # folders of the data


class Skipped(Exception):  # noqa: N818 - not an error
    """A sequence that a check needs is not on disk."""


@dataclass(frozen=True)
class Sequences:
    """Finds sequences in `data` and makes recordings in `folder`, each once; `quick`: a few frames."""

    data: Path
    folder: Path
    quick: bool
    say: Callable[[str], None]

    def source(self, place: str) -> str:
        """The source of a sequence: a folder of the data, or a built-in scene.

        Raises:
            Skipped: the folder is not on disk.
        """
        if place in _SCENES:
            return f"synth:{place}"
        if place == RECORDED_ROOM:
            return f"tum:{self._recorded_room()}"
        folder = (self.data / place).absolute()
        if not folder.is_dir():
            raise Skipped(f"{folder} is not on disk")
        return f"{_SOURCES[place]}:{folder}"

    def options(self, sequence: str, *, half: bool = False) -> tuple[str, ...]:
        """Options of a sequence, as "house", "house-kinect" or "house-kinect-exposure".

        Raises:
            Skipped: its folder is not on disk.
        """
        place, *changes = sequence.split("-")
        noise = "kinect" if "kinect" in changes else "none"
        exposure = ("--exposure", "drift") if "exposure" in changes else ()
        size = () if not half else _HALF_ROOM if place == "room" else _HALF
        frames = ("--frames", str(QUICK_FRAMES)) if self.quick else ()
        return ("--source", self.source(place), "--noise", noise, *exposure, *size, *frames)

    def room_of_camera(self, camera: RoomCamera) -> str:
        """The built-in room as files of a pinhole camera or of a camera with a lens."""
        folder = self.folder / "distorted-room"
        if not (folder / "lens/groundtruth.txt").exists():
            self.say("rendering a room through a lens")
            write_distorted_room(folder, QUICK_FRAMES if self.quick else _LENS_FRAMES)
        return f"tum:{folder / camera}"

    def _recorded_room(self) -> Path:
        folder = self.folder / "recorded-room"
        if not (folder / "groundtruth.txt").exists():
            self.say("recording the room")
            write_recorded_room(folder)
        return folder
