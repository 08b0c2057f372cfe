"""Finds the intact records of an MCAP file and the damaged gaps between them."""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from typing import IO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    Schema,
)
from mcap.stream_reader import get_chunk_data_stream

from hsslam_services.log.chunk_data import unpacked_chunk

MAGIC = b"\x89MCAP0\r\n"
TORN = (
    *(McapError, struct.error, ValueError, RuntimeError, EOFError, KeyError),
    *(OverflowError, MemoryError),  # from an absurd size
)
_HEAD = struct.Struct("<BQ")  # opcode, length of the content
_CHUNK_HEAD = struct.Struct("<QQQII")  # times, size, CRC, length of the compression's name
_MESSAGE_HEAD = struct.Struct("<BQHIQQ")
_WINDOW_BYTES = 2**22
_LONGEST_NAME = 16
_SMALL = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}
# records that can be checked by themselves: opcode, then a length below 2^40
_CANDIDATE = re.compile(rb"(?=[\x06\x09\x0c\x0f].{5}\x00{3})", re.DOTALL)


@dataclass(frozen=True)
class ChunkMessage:
    """One message in a chunk, without its payload."""

    channel: int
    sequence: int
    log_ns: int
    publish_ns: int
    offset: int


@dataclass(frozen=True)
class ChunkContent:
    """The contents of a chunk; `indexes`: its message indexes by channel."""

    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    messages: list[ChunkMessage]
    indexes: dict[int, MessageIndex]


@dataclass(frozen=True)
class Found:
    """An intact record of `length` bytes at `position`; a chunk includes its message indexes.

    `data`: the right bytes of the record; `is_exact`: whether the file has the same bytes.
    """

    position: int
    length: int
    data: bytes
    record: McapRecord
    content: ChunkContent | None
    is_exact: bool


@dataclass(frozen=True)
class Gap:
    """Bytes `position` to `end` without an intact record; `is_tail`: a torn record or zeros at the end."""

    position: int
    end: int
    is_tail: bool


def whole_records(stream: IO[bytes], size: int, start: int = 0) -> Iterator[Found | Gap]:
    """Read the file from `start` to its DataEnd record or its end, with one chunk in memory at a time.

    `size`: of the file. If another process shortens the file meanwhile, the rest is a gap.
    """
    if start == 0:
        stream.seek(0)
        start = len(MAGIC) if stream.read(len(MAGIC)) == MAGIC else 0
    position = start
    while position < size:
        found = record_at(stream, position, size)
        if found is None:
            end = _following(stream, position, size)
            yield Gap(position, end, end == size and _is_tail(stream, position, size))
            position = end
            continue
        yield found
        position += found.length
        if isinstance(found.record, DataEnd):
            return


def record_at(stream: IO[bytes], position: int, size: int) -> Found | None:
    """The intact record that begins at `position`, or None."""
    head = _head(stream, position, size)
    if head is None:
        return None
    opcode, length = head
    try:
        if opcode == Opcode.CHUNK:
            return _chunk(stream, position, length)
        if opcode in _SMALL:
            data = _HEAD.pack(*head) + stream.read(length)
            record = _SMALL[Opcode(opcode)].read(ReadDataStream(BytesIO(data[_HEAD.size :])))
            is_whole = written(record) == data
            return Found(position, len(data), data, record, None, True) if is_whole else None
    except TORN:
        pass
    return None


def written(*records: McapRecord) -> bytes:
    """The records as bytes of a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def definitions(data: bytes) -> tuple[dict[int, Schema], dict[int, Channel]]:
    """Schemas and channels in a sequence of records, by id."""
    content = _content(data)
    return content.schemas, content.channels


def _chunk(stream: IO[bytes], position: int, length: int) -> Found | None:
    head = stream.read(_CHUNK_HEAD.size)
    name_length = _CHUNK_HEAD.unpack(head)[-1]
    if name_length > _LONGEST_NAME or length < len(head) + name_length + 8:
        return None
    name = stream.read(name_length)
    data_length = stream.read(8)
    if struct.unpack("<Q", data_length)[0] != length - len(head) - name_length - 8:
        return None
    body = head + name + data_length + stream.read(length - len(head) - name_length - 8)
    there = _HEAD.pack(Opcode.CHUNK, length) + body
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    unpacked, unpacked_length = get_chunk_data_stream(unpacked_chunk(chunk), validate_crc=True)
    content = _content(unpacked.read(unpacked_length))
    times = [message.log_ns for message in content.messages] or [0]
    chunk = replace(
        chunk,
        uncompressed_size=unpacked_length,
        message_start_time=min(times),
        message_end_time=max(times),
    )
    data = written(chunk, *content.indexes.values())
    there += stream.read(len(data) - len(there))
    if there == data:
        return Found(position, len(data), data, chunk, content, True)
    length_there = _past_indexes(stream, position + _HEAD.size + length) - position
    return Found(position, length_there, data, chunk, content, False)


def _content(data: bytes) -> ChunkContent:
    """Parse the records of a chunk; raises one of TORN if they do not fill it."""
    content = ChunkContent({}, {}, [], {})
    position = 0
    while position < len(data):
        opcode, length = _HEAD.unpack_from(data, position)
        end = position + _HEAD.size + length
        if end > len(data):
            raise ValueError("a record is longer than its chunk")
        if opcode == Opcode.MESSAGE:
            _, _, channel, sequence, log_ns, publish_ns = _MESSAGE_HEAD.unpack_from(data, position)
            message = ChunkMessage(channel, sequence, log_ns, publish_ns, position)
            content.messages.append(message)
            index = content.indexes.setdefault(channel, MessageIndex(channel, []))
            index.records.append((log_ns, position))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            body = ReadDataStream(BytesIO(data[position + _HEAD.size : end]))
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(body)
                content.schemas[schema.id] = schema
            else:
                channel = Channel.read(body)
                content.channels[channel.id] = channel
        position = end
    return content


def _head(stream: IO[bytes], position: int, size: int) -> tuple[int, int] | None:
    """Opcode and length of a record at `position`; None if it does not fit into the file."""
    if position + _HEAD.size > size:
        return None
    stream.seek(position)
    head = stream.read(_HEAD.size)
    if len(head) < _HEAD.size:  # another process shortens the file
        return None
    opcode, length = _HEAD.unpack(head)
    return (opcode, length) if length <= size - position - _HEAD.size else None


def _past_indexes(stream: IO[bytes], position: int) -> int:
    """The end of the message indexes that begin at `position`."""
    size = stream.seek(0, 2)
    while (head := _head(stream, position, size)) and head[0] == Opcode.MESSAGE_INDEX:
        position += _HEAD.size + head[1]
    return position


def _following(stream: IO[bytes], position: int, size: int) -> int:
    """The position of the next intact record: after the damaged one if its length is right, else searched."""
    head = _head(stream, position, size)
    if head is not None:
        end = _past_indexes(stream, position + _HEAD.size + head[1])
        if record_at(stream, end, size) is not None:
            return end
    window = position + 1
    while window < size:
        stream.seek(window)
        content = stream.read(_WINDOW_BYTES)
        for match in _CANDIDATE.finditer(content):
            if record_at(stream, window + match.start(), size) is not None:
                return window + match.start()
        if len(content) <= _HEAD.size or window + len(content) >= size:
            break
        window += len(content) - _HEAD.size
    return size


def _is_tail(stream: IO[bytes], position: int, size: int) -> bool:
    stream.seek(position)
    begin = stream.read(_HEAD.size)
    if len(begin) < _HEAD.size:
        return True
    opcode, length = _HEAD.unpack(begin)
    if 1 <= opcode <= Opcode.DATA_END and length > size - position - _HEAD.size:
        return True
    is_zero = not begin.strip(b"\0")
    while is_zero and (content := stream.read(_WINDOW_BYTES)):
        is_zero = not content.strip(b"\0")
    return is_zero
