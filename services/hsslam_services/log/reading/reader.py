"""Reads the files of a log: their span of time, and the messages of the bus in order of arrival."""

import errno
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final, NamedTuple

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.reader import McapReader, make_reader
from mcap.records import Channel, Chunk, ChunkIndex, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import breakup_chunk

from hsslam_node.errors import UserError
from hsslam_proto.codec import MEDIA_TYPE, Rejected, decode
from hsslam_proto.message import Message
from hsslam_proto.topics import TOPICS, Topic
from hsslam_services.log.chunk_data import messages_in_file, unpacked_chunk
from hsslam_services.log.reading.arrival_order import Record, in_order_of_arrival
from hsslam_services.log.whole_records import TORN

_TOPICS = {topic.name: topic for topic in TOPICS}
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


class ChunkPlace(NamedTuple):
    """Where a chunk of a log begins: the number of its file, and the byte there."""

    file: int
    byte: int


BEGINNING: Final = ChunkPlace(0, 0)


@dataclass(frozen=True)
class Logged:
    """One message of the bus in a log: payload with the present field names, wall clock times.

    `chunk`: where the chunk begins that holds it, if reading that begins there gives the same messages in the
    same order; None if not, as for messages of several channels.
    """

    robot: str
    topic: Topic
    payload: bytes
    encoding: str
    log_ns: int
    publish_ns: int
    chunk: ChunkPlace | None

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


def bus_messages(
    files: list[Path],
    names: Container[str] | None = None,
    start: ChunkPlace = BEGINNING,
) -> Iterator[Logged]:
    """Messages of the bus in order of arrival, of the topics of these names (None: all known).

    This order does not change if the wall clock is set during the run. `start`: the `chunk` of a message
    that an earlier reading gave; reads nothing before it.
    """
    for number, path in enumerate(files[start.file :], start.file):
        with log_reader(path) as reader:
            wanted = [key for key in _keys(reader) if _is_wanted(key, names)]
            if not wanted:
                continue
            first_byte = start.byte if number == start.file else 0
            records = _records(path, reader, wanted, first_byte)
            for schema, channel, record, byte in in_order_of_arrival(records):
                robot, name = _split(channel.topic)
                topic = _TOPICS[name]
                yield Logged(
                    robot=robot,
                    topic=topic,
                    payload=_with_map_epoch(topic, record.data),
                    encoding=f"{MEDIA_TYPE};{schema.name if schema else ''}",
                    log_ns=record.log_time,
                    publish_ns=record.publish_time,
                    chunk=None if byte is None else ChunkPlace(number, byte),
                )


def _records(
    path: Path, reader: McapReader, wanted: list[str], first_byte: int
) -> Iterator[Record]:
    """Records of these keys in the order of the file, chunk by chunk from `first_byte` on; all, by time, if
    the file has no chunks."""
    summary = reader.get_summary()
    if summary is None:
        return
    ids = {number for number, each in summary.channels.items() if each.topic in wanted}
    with path.open("rb") as stream:
        chunks = [each for each in summary.chunk_indexes if each.chunk_start_offset >= first_byte]
        found = _in_chunks(stream, chunks, ids) if summary.chunk_indexes else _by_time(stream, ids)
        for record, byte in found:
            channel = summary.channels[record.channel_id]
            yield summary.schemas.get(channel.schema_id), channel, record, byte


def messages_between(
    path: Path, low_ns: int, high_ns: int
) -> Iterator[tuple[Schema | None, Channel, McapMessage]]:
    """All messages of one file, of the bus or not, from `low_ns` to before `high_ns`, in the file's order.

    Raises:
        UserError: the file is damaged, or there is none.
    """
    with log_reader(path) as reader:
        summary = reader.get_summary()
        if summary is None:
            return
        chunks = [
            each
            for each in summary.chunk_indexes
            if each.message_start_time < high_ns and each.message_end_time >= low_ns
        ]
        with path.open("rb") as stream:
            if summary.chunk_indexes:
                found = (each for each, _ in _in_chunks(stream, chunks, set(summary.channels)))
            else:
                found = messages_in_file(stream)
            for record in found:
                if low_ns <= record.log_time < high_ns:
                    channel = summary.channels[record.channel_id]
                    yield summary.schemas.get(channel.schema_id), channel, record


def _by_time(stream: IO[bytes], ids: set[int]) -> Iterator[tuple[McapMessage, None]]:
    found = [each for each in messages_in_file(stream) if each.channel_id in ids]
    for record in sorted(found, key=lambda each: each.log_time):
        yield record, None


def _in_chunks(
    stream: IO[bytes], chunks: list[ChunkIndex], ids: set[int]
) -> Iterator[tuple[McapMessage, int | None]]:
    for index in sorted(chunks, key=lambda each: each.chunk_start_offset):
        if index.message_index_offsets and ids.isdisjoint(index.message_index_offsets):
            continue
        stream.seek(index.chunk_start_offset + _RECORD_HEADER_BYTES)
        chunk = unpacked_chunk(Chunk.read(ReadDataStream(stream)))
        for record in breakup_chunk(chunk, validate_crc=True):
            if isinstance(record, McapMessage) and record.channel_id in ids:
                yield record, index.chunk_start_offset if len(ids) == 1 else None


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
