"""The frames of a log as a source, `--source mcap:RUN`, and the source from which a log was recorded."""

import sys
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.image_pairs import median_rate_hz
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import (
    BadFrame,
    IsLate,
    LateFrame,
    ReadsInTime,
    of_one_camera,
)
from hsslam_proto.frame_codec import frame_camera, frame_from_message
from hsslam_services.log.channel_copies import RUN_METADATA
from hsslam_services.log.reading.files import Say, log_parts
from hsslam_services.log.reading.logged_frames import LoggedFrames
from hsslam_services.log.reading.reader import log_reader
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.source_table import comes_once, log_place

_RATE_FRAMES = 30  # number of stamps from which the rate is computed
_TWICE_DIFFERS = ("noise", "exposure", "downscale")  # effects that change frames each time
_MOST_LOGS = 8  # longest chain of logs, each recorded from the next


class McapSource(ReadsInTime):
    """Frames of a log (a file, or all parts of a run folder) with their original stamps.

    Frames keep their indices, so that random numbers drawn by frame are the same; a frame that was sent
    twice comes once. Colour is that of the log: a JPEG differs from what the tracker saw. Opening reads the
    whole log (0.3 s for 200 MB). `stamps_ns`, `indices`: of the selected frames, [N] int64.

    Raises:
        UserError: the log is missing or unreadable, or no frame is selected.
    """

    def __init__(self, place: str, options: SourceOptions) -> None:
        files = log_parts(place, lambda text: print(text, file=sys.stderr))
        self._logged = LoggedFrames(files)
        self.name = f"mcap:{place}"
        found: list[tuple[int, int]] = []
        cameras: set[int] = set()
        for _, message in self._logged.since():
            found.append((message.source_stamp_ns, message.index))
            cameras.add(message.publisher)
        if not found:
            raise UserError(f"source mcap:{place}: holds no frames: expected a log with in/frame")
        self._rows = frozenset(options.selected(len(found)))
        if not self._rows:
            raise UserError(f"--start {options.start}: source mcap:{place} has {len(found)} frames")
        self.camera, self.depth_units_per_m = self._first_camera()
        self.stamps_ns, self.indices = np.array(found)[sorted(self._rows)].T
        self.has_one_camera = len(cameras) == 1
        self.frame_count: int | None = len(self._rows)
        self.rate_hz = median_rate_hz(self.stamps_ns[:_RATE_FRAMES])

    def frames_in_time(self, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
        """The selected frames; a `LateFrame` for a late frame, a `BadFrame` for one that cannot be decoded or
        has another camera than the first."""
        rows = frozenset(sorted(self._rows)[first:])
        if not rows:
            return
        last = max(rows)
        for row, message in self._logged.since(min(rows)):
            if row > last:
                return
            if row in rows:
                if is_late(message.index, message.source_stamp_ns):
                    yield LateFrame(message.index, message.source_stamp_ns)
                    continue
                try:
                    frame = frame_from_message(message)
                except UserError as error:
                    yield BadFrame(message.index, message.source_stamp_ns, str(error))
                else:
                    yield of_one_camera(self, frame)

    def _first_camera(self) -> tuple[Camera, float]:
        """Camera and depth scale of the first selected frame whose camera is valid, as in the live run.

        Raises:
            UserError: none is valid; the error of the first one.
        """
        error: UserError | None = None
        for row, message in self._logged.since(min(self._rows)):
            if row not in self._rows:
                continue
            try:
                return frame_camera(message), message.depth_units_per_m
            except UserError as invalid:
                error = error or invalid
        raise UserError(f"source {self.name}: {error}")


def log_stamps(place: str) -> tuple[np.ndarray, None]:
    """Stamps of all frames of a log, [N] int64 ns; colour and depth share one."""
    return McapSource(place, SourceOptions()).stamps_ns, None


@dataclass(frozen=True)
class RecordedSource:
    """A source, as arguments of `open_source`."""

    spec: str
    options: SourceOptions


def recorded_source(spec: str, options: SourceOptions, say: Say) -> RecordedSource:
    """The source `spec`; if it is a log, the source of its frames, with the same selection. If that source
    cannot be read again, such as a camera, it is the log itself.

    Raises:
        UserError: a log is missing or unreadable, or does not name its source.
    """
    for _ in range(_MOST_LOGS):
        place = log_place(spec)
        if not place:
            return RecordedSource(spec, options)
        run = logged_options(log_parts(place, say))
        if run is None:
            raise UserError(f"source {spec}: the log does not name its source")
        if comes_once(run.source):
            return RecordedSource(spec, options)
        log = McapSource(place, options)
        inner = frames_of_run(run, log.indices) if log.has_one_camera else run.source_options
        spec = run.source
        options = replace(
            inner,
            noise=options.noise if inner.noise == "none" else inner.noise,
            downscale=inner.downscale * options.downscale,
        )
    raise UserError(
        f"source {spec}: expected at most {_MOST_LOGS} logs, each recorded from the next"
    )


def frames_of_run(run: ServeOptions, indices: Collection[int]) -> SourceOptions:
    """Options that select the frames of these indices from the source of a run with one camera, and as few
    others as possible."""
    options = run.source_options
    chosen = np.unique(np.fromiter(indices, np.int64))
    if options.reorders:
        return replace(options, frames=int(chosen[-1]) + 1)
    if place := log_place(run.source):  # indices refer to this log
        rows = McapSource(place, SourceOptions()).indices
        first, last, step = _span(rows.searchsorted(chosen))
        return replace(options, start=first, stride=step, frames=(last - first) // step + 1)
    first, last, step = _span(chosen)
    return replace(
        options,
        start=options.start + options.stride * first,
        stride=options.stride * step,
        frames=(last - first) // step + 1,
    )


def _span(chosen: np.ndarray) -> tuple[int, int, int]:
    """First, last and largest common step of numbers in order."""
    return int(chosen[0]), int(chosen[-1]), int(np.gcd.reduce(np.diff(chosen))) or 1


def repeated_effects(options: ServeOptions) -> list[str]:
    """If the source is a log: a warning for each effect that its frames have already and would get again."""
    place, usual = log_place(options.source), ServeOptions()
    given = [name for name in _TWICE_DIFFERS if getattr(options, name) != getattr(usual, name)]
    run = logged_options(log_parts(place, lambda _: None)) if place and given else None
    return [
        f"--{name} {getattr(options, name)}: the frames of {options.source} already have --{name} "
        f"{getattr(run, name)}, and get it again"
        for name in given
        if run is not None and getattr(run, name) != getattr(usual, name)
    ]


def run_metadata(files: Iterable[Path]) -> dict[str, str]:
    """Metadata of the run that wrote the log: `run_id`, `options`, ...; empty if no part has them.

    Each part has a copy; a recovered part may have lost it.

    Raises:
        UserError: the log is damaged.
    """
    for file in files:
        with log_reader(file) as reader:
            for record in reader.iter_metadata():
                if record.name == RUN_METADATA:
                    return record.metadata
    return {}


def logged_options(files: list[Path]) -> ServeOptions | None:
    """The options of the run that wrote the log; None if they are missing or of another version.

    Raises:
        UserError: the log is damaged.
    """
    written = run_metadata(files).get("options", "")
    try:
        return msgspec.json.decode(written.encode(), type=ServeOptions)
    except (msgspec.MsgspecError, UserError):
        return None
