"""Finds logs: each file or folder below a root that a row of the table of sources recognises."""

import dataclasses
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any, cast

from mcap.reader import make_reader

from hsslam_batch.plan.listing import FileStamp, ListedPath, Listing
from hsslam_batch.plan.log import Log, log_id
from hsslam_batch.plan.remote_listing import is_url
from hsslam_node.errors import UserError
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source_row import SourceRow, find_row
from hsslam_proto.topics import FRAME
from hsslam_services.artefacts.replaced_results import EARLIER
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.log.parts import is_part, parts, recovered_from
from hsslam_services.log.reading.reader import log_reader
from hsslam_services.log.whole_records import TORN
from hsslam_services.run.source_table import ALL_SOURCES

RECORDED, _BAG = "mcap", "bag"  # kinds: a log of this service, a bag of ROS


def find_logs(listing: Listing) -> list[Log]:
    """All logs of a listing, by name, with `frames` 0; opens no file.

    If a folder is a log (a run folder, a sequence), the files in it are not. With a warning are left out: a
    log whose path is not UTF-8, since neither manifest nor run can name it, the damaged original of a
    recovered log, and logs in a run folder that are of another run.

    Raises:
        UserError: there are no logs.
    """
    found = []
    for path, kind in _logs_below(listing, listing.alone):
        place = f"{listing.root}/{path}".rstrip("/")
        if not is_utf8(place):
            print(f"warning: {place!r}: left out: expected a path in UTF-8", file=sys.stderr)
            continue
        if (recovered := _recovered_from(listing, path)) is not None:
            print(f"warning: {place}: left out: the original of {recovered}", file=sys.stderr)
            continue
        if kind == RECORDED and (others := list(_others_in(listing, path))):
            more = f" and {len(others) - 1} more" if len(others) > 1 else ""
            print(
                f"warning: {place}: left out {others[0]}{more}: the folder is one log, as it has a run.mcap: "
                "expected each run in a folder of its own",
                file=sys.stderr,
            )
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
                beside_nbytes=_beside_nbytes(listing, path, f"{kind}:{place}"),
            )
        )
    if not found:
        kinds = ", ".join(row.kind for row in _recorded_sources())
        raise UserError(f"{listing.root}: no logs below: expected files or folders of {kinds}")
    return found


def is_utf8(path: str) -> bool:
    """Whether a path is valid UTF-8; Python gives other bytes as lone surrogates."""
    try:
        path.encode()
    except UnicodeEncodeError:
        return False
    return True


def log_files(listing: Listing, path: str, kind: str) -> list[str]:
    """The files of a log; for a run folder only the parts of its log, not the other results."""
    if kind != RECORDED or path in listing.files:
        return list(listing.below(path))
    folder = f"{path}/" if path else ""
    return [folder + name for name in listing.names(path) if is_part(name)]


def names_beside(source: str) -> list[str]:
    """Names of the files beside a recording that its kind of source may read; they may be missing."""
    row = find_row(source, ALL_SOURCES)
    name = source.rstrip("/").rpartition("/")[2]
    stem = PurePosixPath(name).stem
    return [pattern.format(name=name, stem=stem) for pattern in row.beside] if row else []


def planned_files(listing: Listing, log: Log) -> list[str]:
    """The files of a log in a listing of its place.

    Raises:
        UserError: they have changed since the plan.
    """
    files = log_files(listing, listing.alone, log.kind)
    if listing.stamp(files, listing.alone) != FileStamp(log.nbytes, log.version):
        raise UserError(
            f"{log.place}: has changed since the plan: expected the same files, or hsslam-batch plan again"
        )
    return files


def with_frames(logs: Iterable[Log], options: SourceOptions) -> Iterator[Log]:
    """The logs with the number of frames that a run with these options uses; 0: not known before the run."""
    for log in logs:
        if not is_url(log.place):
            log = on_this_machine(log, log.place)
        yield dataclasses.replace(log, frames=_frames(log, options))


def on_this_machine(log: Log, place: str) -> Log:
    """The log at its place on this machine; a single MCAP file is a bag if its header says so."""
    kind = _BAG if log.kind == RECORDED and _is_of_ros(Path(place)) else log.kind
    return dataclasses.replace(log, kind=kind, place=place)


def _logs_below(listing: Listing, path: str) -> Iterator[tuple[str, str]]:
    """Path and kind of each log at or below a path."""
    if kind := _kind(listing, path):
        yield path, kind
        return
    for name in listing.names(path):
        yield from _logs_below(listing, f"{path}/{name}" if path else name)


def _beside_nbytes(listing: Listing, path: str, source: str) -> int:
    """Bytes of the files beside a log; those of a log that is the root itself are not listed."""
    folder, slash, _ = path.rpartition("/")
    beside = (f"{folder}{slash}{name}" for name in names_beside(source))
    return sum(listing.files[one].nbytes for one in beside if one in listing.files) if path else 0


def _recovered_from(listing: Listing, path: str) -> str | None:
    """The recovered log of which a file is the damaged original; None if there is none beside it."""
    folder, slash, name = path.rpartition("/")
    recovered = recovered_from(name)
    return recovered if recovered and f"{folder}{slash}{recovered}" in listing.files else None


def _others_in(listing: Listing, folder: str) -> Iterator[str]:
    """Paths of logs in a run folder that are neither parts of its log nor results of an earlier run."""
    for name in listing.names(folder):
        if name.startswith(EARLIER) or is_part(name) or recovered_from(name):
            continue
        yield from (other for other, _ in _logs_below(listing, f"{folder}/{name}".lstrip("/")))


def _recorded_sources() -> Iterator[SourceRow]:
    return (row for row in ALL_SOURCES if not row.is_live and not row.only_examples)


def _kind(listing: Listing, path: str) -> str:
    """The kind of source of a file or folder; empty if it is no source."""
    place = cast(Any, ListedPath(listing, path))  # has what `looks_like` uses of a Path
    kind = next((row.kind for row in _recorded_sources() if row.looks_like(place)), "")
    return kind if kind != RECORDED or log_files(listing, path, kind) else ""


def _frames(log: Log, options: SourceOptions) -> int:
    """Count frames by the index of a log or the lists of a sequence; reads no images. 0: not known."""
    if is_url(log.place) or log.kind == _BAG:  # a bag is read whole to count them
        return 0
    try:
        if log.kind == RECORDED:
            return len(options.selected(_logged_frames(Path(log.place))))
        return open_any_source(log.source, options).frame_count or 0
    except (UserError, OSError, *TORN):
        return 0  # the run will report the error


def _is_of_ros(place: Path) -> bool:
    """Whether this is an MCAP file of ROS 2."""
    if not place.is_file():
        return False
    try:
        with place.open("rb") as stream:
            return make_reader(stream).get_header().profile == "ros2"
    except (OSError, *TORN):  # the run reports it
        return False


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
