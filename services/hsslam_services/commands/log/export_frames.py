"""The frames of a log as a folder in TUM layout."""

import json
from collections.abc import Iterator
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import format_stamp
from hsslam_proto import messages
from hsslam_proto.frame_order import FrameOrder
from hsslam_proto.topics import FRAME
from hsslam_services.commands.log.progress import log_progress
from hsslam_services.log.frame_compression import compress_frame
from hsslam_services.log.reader import Say, bus_messages

_LISTS = {"rgb": "timestamp file", "depth": "timestamp file", "associations": "colour, depth"}


def export_frames(files: list[Path], folder: Path, say: Say) -> Iterator[str]:
    """rgb/, depth/, rgb.txt, depth.txt, associations.txt and camera.json, as `tum:<folder>` opens it.

    Images are the bytes of the log: colour as JPEG or PNG, depth as 16-bit PNG. Yields what it wrote.

    Raises:
        UserError: the folder holds frames already, or the camera changes on the way.
    """
    camera: dict[str, object] = {}
    order, count = FrameOrder(), 0
    with _Lists(folder) as lists, log_progress("frames", files) as progress:
        for logged in progress.over(bus_messages(files, {FRAME.name})):
            frame = logged.message()
            assert isinstance(frame, messages.Frame)
            if not order.is_new(frame.publisher, frame.index, frame.stamp_ns):
                continue  # sent again
            count += 1
            camera = camera or _camera(frame)
            if camera != _camera(frame):
                raise UserError(f"frame {frame.index}: another camera than before: expected one")
            lists.add(compress_frame(frame, "png"))
    if not count:
        say("no frames: the log holds none")
        return
    (folder / "camera.json").write_text(json.dumps(camera, indent=1) + "\n")
    yield f"{folder}: {count} frames, for --source tum:{folder}"


class _Lists:
    """The image folders with their lists; made when the first frame comes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._written: dict[str, int] = {}  # frames with this stamp
        self._lines: dict[str, list[str]] = {name: [f"# {what}\n"] for name, what in _LISTS.items()}

    def __enter__(self) -> "_Lists":
        if (self._folder / "rgb.txt").exists():
            raise UserError(f"{self._folder}: holds frames already: expected a new folder")
        return self

    def __exit__(self, *_: object) -> None:
        for name, lines in self._lines.items():
            if len(lines) > 1:
                (self._folder / f"{name}.txt").write_text("".join(lines))

    def add(self, frame: messages.Frame) -> None:
        stamp = format_stamp(frame.source_stamp_ns)
        number = self._written[stamp] = self._written.get(stamp, 0) + 1
        name = stamp if number == 1 else f"{stamp}-{number}"  # a camera that repeats its stamp
        color = f"rgb/{name}.{'jpg' if frame.color_encoding == 'jpeg' else 'png'}"
        depth = f"depth/{name}.png"
        for file, data in ((color, frame.color), (depth, frame.depth)):
            path = self._folder / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        self._lines["rgb"].append(f"{stamp} {color}\n")
        self._lines["depth"].append(f"{stamp} {depth}\n")
        self._lines["associations"].append(f"{stamp} {color} {stamp} {depth}\n")


def _camera(frame: messages.Frame) -> dict[str, object]:
    """As in `camera.json`; frames on the bus have no distortion."""
    return {
        "width": frame.width_px,
        "height": frame.height_px,
        "fx": frame.fx,
        "fy": frame.fy,
        "cx": frame.cx,
        "cy": frame.cy,
        "distortion": [],
        "depth_scale": frame.depth_units_per_m,
    }
