"""Opens logs for reading; recovers an unfinished log first, and refuses a log that a run still writes."""

import errno
import fcntl
import os
import time
from collections.abc import Callable, Container, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import IO

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.reader import McapReader, make_reader
from mcap.records import Channel, Chunk, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import breakup_chunk

from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path
from hsslam_proto.codec import MEDIA_TYPE, Rejected, decode
from hsslam_proto.message import Message
from hsslam_proto.topics import TOPICS, Topic
from hsslam_services.log.arrival_order import in_order_of_arrival
from hsslam_services.log.file_index import is_finished
from hsslam_services.log.parts import part_number, parts
from hsslam_services.log.recovery import Recovered, locks_in_time, recover
from hsslam_services.log.whole_records import MAGIC, TORN
from hsslam_services.run.find_run import running_runs
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.source_table import log_place

Say = Callable[[str], None]
_TOPICS = {topic.name: topic for topic in TOPICS}
_STILL_S = 2.0  # an unfinished log that has changed since may be a copy in progress
_RECORD_HEADER_BYTES = 9  # opcode, length
_FORMER_KEY = b"\xa5world"  # msgpack of the string


@contextmanager
def log_reader(path: Path) -> Iterator[McapReader]:
    """A reader that checks all checksums; turns errors of a damaged file in the block into `UserError`.

    Raises:
        UserError: the file is damaged, or there is none.
    """
    with _opened(path) as stream:
        try:
            yield make_reader(stream, validate_crcs=True)
        except TORN as error:
            raise _damaged(path, error) from None
        except OSError as error:
            if error.errno != errno.EINVAL:  # a seek to an impossible place
                raise
            raise _damaged(path, error) from None


def _opened(path: Path) -> IO[bytes]:
    try:
        return path.open("rb")
    except FileNotFoundError:
        raise UserError(
            f"{path}: no such file: expected a part that --log-keep of a run does not remove meanwhile"
        ) from None


def log_span_ns(files: Iterable[Path]) -> tuple[int, int]:
    """Wall clock of the earliest and of the latest message of a log, ns; both 0 without messages.

    If the clock was set back, the earliest message may be in a later part.

    Raises:
        UserError: a part is damaged.
    """
    spans_ns = []
    for path in files:
        with log_reader(path) as reader:
            summary = reader.get_summary()
        found = summary.statistics if summary else None
        if found and found.message_count:
            spans_ns.append((found.message_start_time, found.message_end_time))
    starts_ns, ends_ns = zip(*spans_ns, strict=True) if spans_ns else ((0,), (0,))
    return min(starts_ns), max(ends_ns)


def _damaged(path: Path, error: Exception) -> UserError:
    return UserError(
        f"{path}: damaged ({error!s:.120}): expected an intact MCAP file "
        "(hsslam-log recover keeps the intact records)"
    )


@dataclass(frozen=True)
class Logged:
    """One message of the bus in a log: payload with the present field names, wall clock times."""

    robot: str
    topic: Topic
    payload: bytes
    encoding: str
    log_ns: int
    publish_ns: int

    def message(self) -> Message:
        """The decoded message; raises UserError if this version cannot read it."""
        message = decode(self.topic, self.payload, self.encoding)
        if isinstance(message, Rejected):
            raise UserError(f"log: {message.text}")
        return message


def _with_map_epoch(topic: Topic, payload: bytes) -> bytes:
    """The payload with the field `map_epoch`, which logs from before 0.1.0 call `world`."""
    is_of_epoch = "map_epoch" in topic.message.__struct_fields__
    if not is_of_epoch or _FORMER_KEY not in payload:
        return payload
    try:
        fields = msgspec.msgpack.decode(payload)
        return msgspec.msgpack.encode({"map_epoch": fields.pop("world"), **fields})
    except (msgspec.MsgspecError, ValueError, KeyError, AttributeError, RecursionError):
        return payload  # no such field, or malformed: `decode` reports it


def log_parts(place: str | Path, say: Say) -> list[Path]:
    """The readable files of a log: one MCAP file, or all parts in a run folder, in order.

    Recovers unfinished files; `say` takes a line about each. Leaves out parts without messages, of a
    recorder that was killed at once, if there are others.

    Raises:
        UserError: no such file or folder, no MCAP file, or a run still writes it.
    """
    found = log_files(place)
    for before, after in pairwise(found):
        if part_number(after) != part_number(before) + 1:
            say(f"{after}: the part before it is missing, after {before.name}: the log has a gap")
    for file in found:
        make_readable(file, say)
    return [file for file in found if len(found) == 1 or _has_messages(file)] or found


def _has_messages(path: Path) -> bool:
    with log_reader(path) as reader:
        summary = reader.get_summary()
        return not (summary and summary.statistics and summary.statistics.message_count == 0)


def log_files(place: str | Path) -> list[Path]:
    """The files of a log, without recovery.

    Raises:
        UserError: a folder without a log, or one that cannot be read.
    """
    path = user_path(place)
    try:
        if not path.is_dir():
            return [path]
        os.scandir(path).close()  # glob passes over a folder that cannot be read
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: expected a log or a run folder") from None
    found = parts(path)
    if not found:
        raise UserError(f"{path}: no log there: expected a run folder with run.mcap")
    return found


def is_log(place: str) -> bool:
    """Whether `place` names a log, not a run folder."""
    return bool(log_place(place)) or place.endswith(".mcap")


def make_readable(path: Path, say: Say) -> bool:
    """Recover the file if it is unfinished, and report this by `say`; False if it is finished.

    Raises:
        UserError: the file cannot be read, is no MCAP file, is still written, or is unfinished and not ours.
    """
    try:
        with path.open("rb") as stream:
            first = stream.read(len(MAGIC))
            if not MAGIC.startswith(first) or not (first or _is_named_as_log(path)):
                raise UserError(f"{path}: not an MCAP file: expected a log such as run.mcap")
        expect_closed(path)
        if is_finished(path):
            return False
        recovered = _recovered(path)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: expected a log such as run.mcap") from None
    say(f"{path}: {recovered.line()}")
    return True


def _recovered(path: Path) -> Recovered:
    try:
        return recover(path)
    except PermissionError:
        raise UserError(
            f"{path}: its end is missing, and this user may not complete it: expected a file and a folder "
            "to write, such as a copy"
        ) from None


def _is_named_as_log(path: Path) -> bool:
    """Whether recovery may make a log of this file if it is empty."""
    return path.suffix == ".mcap"


def expect_closed(path: Path) -> None:
    """Check that nothing still writes the file: a run by its file lock, a copy in progress by a change.

    On a file system without locks, an unfinished log counts as being written while the run of its folder
    lives. Waits 2 s at most.

    Raises:
        UserError: a run or another program still writes the file.
        OSError: the file cannot be read.
    """
    with path.open("rb") as stream:
        try:
            is_written = not locks_in_time(stream, fcntl.LOCK_SH)
        except OSError:  # no locks
            is_written = not is_finished(path) and _run_lives(path.parent)
    if is_written:
        raise UserError(f"{path}: a run is still writing it: expected a log that is closed")
    if not is_finished(path) and not _is_where_it_was_recorded(path):
        _expect_no_change(path)


def _is_where_it_was_recorded(path: Path) -> bool:
    """Whether the log is in its run's own folder: there only the recorder writes it, which locks it."""
    with suppress(UserError, OSError):
        return path.parent.samefile(RunInfo.read(path.parent).run_dir)
    return False


def _expect_no_change(path: Path) -> None:
    """Check that the file stays as it is until its last change is `_STILL_S` old.

    Raises:
        UserError: it changes: it is being copied here.
        OSError: the file cannot be read.
    """
    before = path.stat()
    age_s = time.time() - before.st_mtime
    if age_s > _STILL_S:
        return
    time.sleep(min(_STILL_S - age_s, _STILL_S))
    after = path.stat()
    if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        raise UserError(
            f"{path}: another program is writing it: expected a log that has been copied whole"
        )


def _run_lives(folder: Path) -> bool:
    return any(Path(place).exists() and Path(place).samefile(folder) for place in running_runs())


def bus_messages(files: list[Path], names: Container[str] | None = None) -> Iterator[Logged]:
    """Messages of the bus in order of arrival, of the topics of these names (None: all known).

    This order does not change if the wall clock is set during the run.
    """
    for path in files:
        with log_reader(path) as reader:
            wanted = [key for key in _keys(reader) if _is_wanted(key, names)]
            if not wanted:
                continue
            for schema, channel, record in in_order_of_arrival(_records(path, reader, wanted)):
                robot, name = _split(channel.topic)
                topic = _TOPICS[name]
                yield Logged(
                    robot=robot,
                    topic=topic,
                    payload=_with_map_epoch(topic, record.data),
                    encoding=f"{MEDIA_TYPE};{schema.name if schema else ''}",
                    log_ns=record.log_time,
                    publish_ns=record.publish_time,
                )


def _records(
    path: Path, reader: McapReader, wanted: list[str]
) -> Iterator[tuple[Schema | None, Channel, McapMessage]]:
    """Records of these keys in the order of the file, chunk by chunk; by time if the file has no chunks."""
    summary = reader.get_summary()
    if summary is None or not summary.chunk_indexes:
        yield from reader.iter_messages(wanted)
        return
    ids = {number for number, each in summary.channels.items() if each.topic in wanted}
    with path.open("rb") as stream:
        for index in sorted(summary.chunk_indexes, key=lambda each: each.chunk_start_offset):
            if index.message_index_offsets and ids.isdisjoint(index.message_index_offsets):
                continue
            stream.seek(index.chunk_start_offset + _RECORD_HEADER_BYTES)
            chunk = Chunk.read(ReadDataStream(stream))
            for record in breakup_chunk(chunk, validate_crc=True):
                if isinstance(record, McapMessage) and record.channel_id in ids:
                    channel = summary.channels[record.channel_id]
                    yield summary.schemas.get(channel.schema_id), channel, record


def _keys(reader: McapReader) -> list[str]:
    summary = reader.get_summary()
    return sorted({channel.topic for channel in summary.channels.values()}) if summary else []


def _is_wanted(key: str, names: Container[str] | None) -> bool:
    name = _split(key)[1]
    return name in _TOPICS and (names is None or name in names)


def _split(key: str) -> tuple[str, str]:
    """Robot and topic name of a key `hsslam/<robot>/<name>`; empty for the /viz layer."""
    root, _, rest = key.partition("/")
    robot, _, name = rest.partition("/")
    return (robot, name) if root == "hsslam" else ("", "")
