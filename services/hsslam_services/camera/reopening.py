"""Reopens a source that was lost after it had given frames, with growing pauses."""

from collections.abc import Generator, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import camera_difference
from hsslam_node.map.store import KeyframeStore
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import reports_of
from hsslam_node.sources.source import BadFrame, NoFrame, Source, SourceLostError
from hsslam_node.sources.source_row import find_row
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.camera.map_camera import difference_from_map
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.launch.worker import FIRST_PAUSE_S, Worker
from hsslam_services.run.source_table import ALL_SOURCES, is_live

MAY_PASS = (SourceLostError, UserError, OSError, RuntimeError)  # once it has given frames


def open_with_patience(worker: Worker, *, had_frames: bool, after: int = 0) -> Source | None:
    """Open the run's source; None if the worker must stop first.

    `had_frames`: the source has given frames in this run; then a live camera is tried again on errors, and if
    it has other intrinsics than the keyframes. `after`: number of frames that a live camera gave; `--start`
    is not applied again, and `--frames` counts them.

    Raises:
        UserError: the source gave no frame yet, and cannot be opened or has another camera than a saved map.
        SourceLostError: a recording that has given frames cannot be opened any more.
    """
    reported = ""
    row = find_row(worker.options.source, ALL_SOURCES)
    if row is not None and row.reads_to_count and worker.options.frames is None:
        worker.event(
            "info", f"source {worker.options.source}: it is read to its end, to count its frames"
        )
    for _ in worker.tries():
        try:
            options = replace(_rest(worker.run.source_options, after), is_reopened=had_frames)
            source = open_any_source(worker.options.source, options, worker.should_stop)
            _expect_same_camera(worker, source, is_first=not had_frames)
            return source
        except MAY_PASS as error:
            if worker.should_stop():  # stopped while opening a live camera
                return None
            if not had_frames:
                raise
            if not is_live(worker.options.source):  # the supervisor restarts the process some times
                raise SourceLostError(str(error)) from error
            if str(error) != reported:
                reported = str(error)
                worker.event("warning", f"{reported}: the camera tries again")
        worker.count("opened in vain")
    return None


def _expect_same_camera(worker: Worker, source: Source, *, is_first: bool) -> None:
    """Raise UserError, and release a live camera, if there are keyframes of another camera: of the saved map
    if no frame has come, else of this run."""
    try:
        keyframes = KeyframeStore(ArenaView(Path(worker.run.arena_dir)))
    except KeyError:  # none yet
        return
    if is_first:
        difference = difference_from_map(source.name, source, keyframes)
        why = f"--map {worker.options.map}: {difference}"
    else:
        difference = camera_difference(source, keyframes)
        why = f"source {source.name}: {difference} as in the keyframes"
    if difference:
        for _ in source.frames():
            break  # the end of a started iterator releases the camera
        raise UserError(why)


def live_frames(
    worker: Worker, source: Source, first: int
) -> Generator[Frame | BadFrame, None, None]:
    """Frames of a live camera, numbered from `first`; reopens a lost camera.

    Raises:
        UserError: the camera fails before its first frame.
    """
    index, used = first, 0
    opened: Source | None = source
    while opened is not None:
        try:
            for item in with_reports(worker, opened, opened.frames()):
                if isinstance(item, NoFrame):
                    yield item
                    continue
                if index == worker.options.frames:  # a plugin need not count them
                    return
                yield replace(item, index=index)
                index, used = index + 1, used + isinstance(item, Frame)
            return
        except MAY_PASS as error:
            if used == 0 and first == 0:
                raise
            worker.event("warning", f"{error}: the camera opens the source again")
            worker.count("reopened")
        if index == worker.options.frames:
            return
        worker.pause(FIRST_PAUSE_S)
        opened = open_with_patience(worker, had_frames=True, after=index)


def with_reports(
    worker: Worker, source: Source, items: Iterable[Frame | BadFrame]
) -> Iterator[Frame | BadFrame]:
    """The items of a source; sends its reports as warnings and counts them."""
    reports = reports_of(source)
    for item in items:
        for report in reports.take():
            worker.warn_once(report)
        yield item
    for report in reports.take():
        worker.warn_once(report)


def _rest(options: SourceOptions, after: int) -> SourceOptions:
    """The options to reopen a live camera that has given `after` frames."""
    left = options.frames and options.frames - after
    return replace(options, start=0, frames=left) if after else options
