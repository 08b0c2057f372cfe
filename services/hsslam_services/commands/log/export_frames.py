"""Writes the frames of a log as a folder in TUM layout."""

import json
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from hsslam_node.durable_file import write_durably
from hsslam_node.geometry.trajectory import format_stamp
from hsslam_proto import messages
from hsslam_proto.frame_order import FrameOrder
from hsslam_proto.topics import FRAME
from hsslam_services.commands.log.progress import log_progress
from hsslam_services.log.frame_compression import compress_frame
from hsslam_services.log.reading.files import Say
from hsslam_services.log.reading.reader import bus_messages

# rgb.txt, by which readers know the folder, is written last
_LISTS = {"associations": "colour, depth", "depth": "timestamp file", "rgb": "timestamp file"}


def export_frames(files: list[Path], folder: Path, say: Say) -> Iterator[str]:
    """Write rgb/, depth/, rgb.txt, depth.txt, associations.txt and camera.json for `tum:<folder>`.

    Images are the bytes of the log: colour as JPEG or PNG, depth as 16-bit PNG. Frames with other intrinsics
    go to a separate folder beside it, frames-2, .... Yields a line for each folder. After an error there are
    images without lists, which are no recording; a repeated export replaces them.
    """
    order, found = FrameOrder(), dict[str, _Lists]()
    with ExitStack() as written, log_progress("frames", files) as progress:
        for logged in progress.over(bus_messages(files, {FRAME.name})):
            frame = logged.message()
            assert isinstance(frame, messages.Frame)
            if not order.is_new(frame.publisher, frame.index, frame.stamp_ns):
                continue  # a frame that was sent again
            camera = _camera(frame)
            if camera not in found:
                number = f"-{len(found) + 1}" if found else ""
                lists = _Lists(folder.with_name(f"{folder.name}{number}"), camera)
                found[camera] = written.enter_context(lists)
            found[camera].add(compress_frame(frame, "png"))
    if not found:
        say("no frames: the log has none")
    for lists in found.values():
        yield f"{lists.folder}: {lists.count} frames, for --source tum:{lists.folder}"


class _Lists:
    """The folder of the images of one camera and its lists; made with the first frame."""

    def __init__(self, folder: Path, camera: str) -> None:
        self.folder, self.count = folder, 0
        self._camera = camera
        self._written: dict[str, int] = {}  # number of frames, by stamp
        self._lines: dict[str, list[str]] = {name: [f"# {what}\n"] for name, what in _LISTS.items()}

    def __enter__(self) -> "_Lists":
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None and self.count:
            write_durably(self.folder / "camera.json", self._camera.encode())
            for name, lines in self._lines.items():
                write_durably(self.folder / f"{name}.txt", "".join(lines).encode())

    def add(self, frame: messages.Frame) -> None:
        stamp = format_stamp(frame.source_stamp_ns)
        number = self._written[stamp] = self._written.get(stamp, 0) + 1
        name = stamp if number == 1 else f"{stamp}-{number}"  # the camera repeats its stamp
        color = f"rgb/{name}.{'jpg' if frame.color_encoding == 'jpeg' else 'png'}"
        depth = f"depth/{name}.png"
        for file, data in ((color, frame.color), (depth, frame.depth)):
            path = self.folder / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        self._lines["rgb"].append(f"{stamp} {color}\n")
        self._lines["depth"].append(f"{stamp} {depth}\n")
        self._lines["associations"].append(f"{stamp} {color} {stamp} {depth}\n")
        self.count += 1


def _camera(frame: messages.Frame) -> str:
    """The camera.json of a frame; frames on the bus have no distortion."""
    camera = {
        "width": frame.width_px,
        "height": frame.height_px,
        "fx": frame.fx,
        "fy": frame.fy,
        "cx": frame.cx,
        "cy": frame.cy,
        "distortion": [],
        "depth_scale": frame.depth_units_per_m,
    }
    return json.dumps(camera, indent=1) + "\n"
