"""Makes unfinished or damaged logs readable; keeps all intact chunks, and a damaged original beside them."""

import contextlib
import fcntl
import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap.reader import make_reader
from mcap.records import Attachment, Chunk, DataEnd, Header, Metadata

from hsslam_node import __version__
from hsslam_node.durable_file import sync_folder
from hsslam_node.errors import UserError
from hsslam_services.log.channel_copies import CHANNELS, LIBRARY, RUN_METADATA
from hsslam_services.log.chunk_data import messages_in_file, unpacked_lz4
from hsslam_services.log.file_index import FileIndex, is_finished
from hsslam_services.log.parts import for_damaged
from hsslam_services.log.whole_records import (
    MAGIC,
    TORN,
    Found,
    Gap,
    definitions,
    record_at,
    whole_records,
    written,
)

_LOCK_PATIENCE_S, _LOCK_POLL_S = 2.0, 0.02


@dataclass(frozen=True)
class Recovered:
    """Result of a recovery; `counts`: number of messages by topic.

    `was_whole`: there was nothing to do. `gaps`: number of damaged places that were skipped, in total
    `skipped_bytes`; `original`: path of the damaged file.
    """

    counts: dict[str, int]
    was_whole: bool = False
    gaps: int = 0
    skipped_bytes: int = 0
    original: Path | None = None

    def line(self) -> str:
        """The result in words, for the user."""
        if self.was_whole:
            return "was finished already"
        found = f"recovered {sum(self.counts.values())} messages"
        if self.original is None:
            return f"was not finished: {found}"
        places = f"{self.gaps} damaged place{'s' if self.gaps > 1 else ''}"
        skipped = f"skipped {places} ({self.skipped_bytes / 1e3:.1f} kB)"
        return f"was damaged: {found}, {skipped}; the original is {self.original.name}"


def recover(path: Path) -> Recovered:
    """Check the whole file and make it readable.

    If only the end is missing, writes it in place. If the file is damaged, replaces it by a copy with all
    intact records; the original stays as NAME.damaged.mcap beside it. Files of other programs stay as they
    are. A link stays, and the file that it names is recovered.

    Raises:
        UserError: another process writes the file, or it is of another program and unfinished or damaged.
        OSError: the file cannot be written, or there is no room for the copy (the original stays).
    """
    path = path.resolve()
    with path.open("r+b") as stream:
        lock_log(stream, path)
        if not os.path.samestat(os.fstat(stream.fileno()), path.stat()):
            return recover(path)  # another process has put the recovered log in its place
        survey = _survey(stream)
        if (
            survey.damage
            and not survey.index.has_chunks
            and is_finished(path)
            and _is_readable(path)
        ):
            return Recovered(survey.index.counts, was_whole=True)  # messages without chunks
        if not survey.is_ours:
            if not survey.damage and is_finished(path):
                return Recovered(survey.index.counts, was_whole=True)
            what = "damaged" if survey.damage else "unfinished"
            raise UserError(
                f"{path}: {what}, and no log of this program: expected an intact MCAP file"
            )
        if survey.damage:
            return _copied(stream, path, survey)
        if is_finished(path):
            return Recovered(survey.index.counts, was_whole=True)
        _finish(stream, survey)
        return Recovered(survey.index.counts)


def _is_readable(path: Path) -> bool:
    """Whether the library reads as many messages as the summary counts, with all checksums right."""
    try:
        with path.open("rb") as stream:
            summary = make_reader(stream, validate_crcs=True).get_summary()
            count = sum(1 for _ in messages_in_file(stream))
    except TORN:
        return False
    statistics = summary.statistics if summary else None
    return statistics is not None and count == statistics.message_count > 0


def lock_log(stream: IO[bytes], path: Path) -> None:
    """Lock the file against other writers while `stream` is open; waits 2 s at most for those that read it or
    make it readable.

    Raises:
        UserError: another process writes it.
    """
    try:
        is_locked = locks_in_time(stream, fcntl.LOCK_EX)
    except OSError:  # a file system without locks
        return
    if not is_locked:
        raise UserError(f"{path}: a run is still writing it: expected a log that is closed")


def locks_in_time(stream: IO[bytes], kind: int) -> bool:
    """Lock a file by `fcntl.LOCK_SH` or `LOCK_EX`; False if others hold it for 2 s.

    Raises:
        OSError: the file system has no locks.
    """
    deadline_s = time.monotonic() + _LOCK_PATIENCE_S
    while True:
        try:
            fcntl.flock(stream.fileno(), kind | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= deadline_s:
                return False
            time.sleep(_LOCK_POLL_S)
        else:
            return True


@dataclass
class _Survey:
    """The contents of a file; `end`: byte after its last record."""

    index: FileIndex = field(default_factory=FileIndex)
    damage: list[Gap] = field(default_factory=list)
    profile: str = ""
    is_ours: bool = False
    end: int = 0
    last: Found | None = None
    size: int = 0


def _survey(stream: IO[bytes]) -> _Survey:
    survey = _Survey(size=stream.seek(0, 2))
    inexact: list[Found] = []
    for found in whole_records(stream, survey.size):
        if isinstance(found, Gap):
            if not found.is_tail:
                survey.damage.append(found)
            continue
        if isinstance(found.record, DataEnd):
            _define_from_summary(survey, stream, found.position + found.length)
            break
        _take(survey, found)
        if not found.is_exact:
            inexact.append(found)
        survey.last, survey.end = found, found.position + len(found.data)
    # the last chunk may lack message indexes; elsewhere this is damage
    survey.damage += [
        Gap(found.position, found.position, False)
        for found in inexact
        if found is not survey.last or found.position + found.length != _data_end(survey, stream)
    ]
    stream.seek(0)
    if survey.last is None and MAGIC.startswith(stream.read(len(MAGIC))):
        survey.is_ours = not survey.damage  # an empty log
    survey.index.stand_in()
    topics = [channel.topic for channel in survey.index.channels.values()]
    survey.is_ours = survey.is_ours or any(topic.startswith("hsslam/") for topic in topics)
    return survey


def _take(survey: _Survey, found: Found) -> None:
    survey.index.add(found, found.position)
    record = found.record
    if isinstance(record, Header):
        survey.profile = record.profile
        survey.is_ours |= record.library.startswith(LIBRARY)
    elif isinstance(record, Metadata):
        survey.is_ours |= record.name == RUN_METADATA
    elif isinstance(record, Attachment) and record.name == CHANNELS:
        with contextlib.suppress(*TORN):
            survey.index.define(*definitions(unpacked_lz4(record.data)))


def _data_end(survey: _Survey, stream: IO[bytes]) -> int:
    """Byte after the last record in the file; -1 if another record follows it."""
    last = survey.last
    if last is None:
        return 0
    end = last.position + last.length
    return -1 if record_at(stream, end, survey.size) is not None else end


def _define_from_summary(survey: _Survey, stream: IO[bytes], position: int) -> None:
    """Take the copies of schemas and channels at the end of a finished file."""
    while (found := record_at(stream, position, survey.size)) is not None:
        if isinstance(found.record, Chunk):
            return
        survey.index.add(found, found.position)
        position += found.length


def _finish(stream: IO[bytes], survey: _Survey) -> None:
    """Write the end of the file after its last intact record."""
    if survey.last is None:
        stream.seek(0)
        stream.write(MAGIC + written(Header("", f"{LIBRARY} {__version__}")))
        survey.end = stream.tell()
    elif not survey.last.is_exact:  # write its message indexes again
        stream.seek(survey.last.position)
        stream.write(survey.last.data)
    stream.truncate(survey.end)
    stream.seek(survey.end)
    stream.write(survey.index.end(survey.end))
    stream.flush()
    os.fsync(stream.fileno())


def _copied(stream: IO[bytes], path: Path, survey: _Survey) -> Recovered:
    copy = path.with_name(f".{path.name}.recovering")
    try:
        with copy.open("wb") as out:
            counts = _copy(stream, survey, out)
            out.flush()
            os.fsync(out.fileno())
        original = for_damaged(path)
        try:
            original.hardlink_to(path)
        except OSError:  # a file system without links
            path.rename(original)
        copy.replace(path)
        sync_folder(path.parent)
    except BaseException:  # Ctrl-C, too, leaves no copy
        copy.unlink(missing_ok=True)
        raise
    skipped = sum(gap.end - gap.position for gap in survey.damage)
    return Recovered(counts, False, len(survey.damage), skipped, original)


def _copy(stream: IO[bytes], survey: _Survey, out: IO[bytes]) -> dict[str, int]:
    """Write all intact records; schemas and channels come first, as chunks may lack them."""
    index = FileIndex()
    index.define(survey.index.schemas, survey.index.channels)
    out.write(MAGIC + written(Header(survey.profile, f"{LIBRARY} {__version__} recovery")))
    out.write(written(*index.schemas.values(), *index.channels.values()))
    for found in whole_records(stream, survey.size):
        if isinstance(found, Found) and not isinstance(found.record, (Header, DataEnd)):
            index.add(found, out.tell())
            out.write(found.data)
    index.stand_in()
    out.write(index.end(out.tell()))
    return index.counts
