"""What is a log: every file or folder below a root that a row of the table of sources recognises."""

import dataclasses
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, cast

from hsslam_batch.plan.listing import ListedPath, Listing
from hsslam_batch.plan.log import Log, log_id
from hsslam_batch.plan.remote_listing import is_url
from hsslam_node.errors import UserError
from hsslam_node.sources.options.source import SourceOptions
from hsslam_proto.topics import FRAME
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.log.parts import is_part, parts
from hsslam_services.log.reader import log_reader
from hsslam_services.run.source_table import ALL_SOURCES

_LOG = "mcap"


def find_logs(listing: Listing) -> list[Log]:
    """All logs of a listing, by name; nothing is opened, so `frames` is 0.

    A folder that is a log (a run folder, a sequence) is one log, and what lies in it is none. A log whose
    path is not UTF-8 is left out with a warning: neither manifest nor run could name it.

    Raises:
        UserError: there is none.
    """
    found = []
    for path, kind in _logs_below(listing, listing.alone):
        place = f"{listing.root}/{path}".rstrip("/")
        if not is_utf8(place):
            print(f"warning: {place!r}: left out: expected a path in UTF-8", file=sys.stderr)
            continue
        stamp = listing.stamp(log_files(listing, path, kind), path)
        name = path or Path(listing.root).name
        found.append(
            Log(
                index=len(found),
                id=log_id(name, stamp.nbytes, stamp.version),
                name=name,
                kind=kind,
                place=place,
                nbytes=stamp.nbytes,
                version=stamp.version,
                frames=0,
            )
        )
    if not found:
        kinds = ", ".join(row.kind for row in ALL_SOURCES if not row.only_examples)
        raise UserError(f"{listing.root}: no logs below: expected files or folders of {kinds}")
    return found


def is_utf8(path: str) -> bool:
    """Whether a path can be written as text: other bytes come as lone surrogates."""
    try:
        path.encode()
    except UnicodeEncodeError:
        return False
    return True


def log_files(listing: Listing, path: str, kind: str) -> list[str]:
    """The files that make a log: of a run folder the parts of its log, not its other results."""
    if kind != _LOG or path in listing.files:
        return list(listing.below(path))
    folder = f"{path}/" if path else ""
    return [folder + name for name in listing.names(path) if is_part(name)]


def with_frames(logs: Iterable[Log], options: SourceOptions) -> Iterator[Log]:
    """The logs with the number of frames that a run with these options uses; 0 if it cannot be told."""
    for log in logs:
        yield dataclasses.replace(log, frames=_frames(log, options))


def _logs_below(listing: Listing, path: str) -> Iterator[tuple[str, str]]:
    """Path and kind of each log at or below a path."""
    if kind := _kind(listing, path):
        yield path, kind
        return
    for name in listing.names(path):
        yield from _logs_below(listing, f"{path}/{name}" if path else name)


def _kind(listing: Listing, path: str) -> str:
    """The kind of source that a file or folder is; empty if it is none."""
    place = cast(Any, ListedPath(listing, path))  # all that `looks_like` asks
    rows = (row for row in ALL_SOURCES if not row.is_live and not row.only_examples)
    kind = next((row.kind for row in rows if row.looks_like(place)), "")
    return kind if kind != _LOG or log_files(listing, path, kind) else ""


def _frames(log: Log, options: SourceOptions) -> int:
    """Without reading the images: of a log its index, of a sequence its lists."""
    if is_url(log.place):
        return 0
    try:
        if log.kind == _LOG:
            return len(options.selected(_logged_frames(Path(log.place))))
        return open_any_source(log.source, options).frame_count or 0
    except UserError:
        return 0  # its run reports what is wrong


def _logged_frames(place: Path) -> int:
    count = 0
    for path in parts(place) if place.is_dir() else [place]:
        with log_reader(path) as reader:
            summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            return 0
        for number, messages in summary.statistics.channel_message_counts.items():
            if summary.channels[number].topic.endswith(f"/{FRAME.name}"):
                count += messages
    return count
