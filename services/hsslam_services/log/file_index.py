"""The end of an MCAP file: index and statistics, gathered from its records."""

import struct
import zlib
from collections import Counter
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from hsslam_services.log.whole_records import MAGIC, ChunkContent, Found, written

_FOOTER = struct.Struct("<BQQQI")


class FileIndex:
    """Collects records by `add`; `end` returns the bytes that close the file.

    `schemas` and `channels` are by id. `stand_in` defines each channel that messages use and no record
    defines as `lost/ID`, so that readers find the others.
    """

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: Counter[int] = Counter()  # messages by channel
        self._times_ns: list[int] = []  # of the first and the last message

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages by topic."""
        return {self.channels[id].topic: count for id, count in self._counts.items()}

    @property
    def has_chunks(self) -> bool:
        return bool(self._chunks)

    def define(self, schemas: dict[int, Schema], channels: dict[int, Channel]) -> None:
        """Add definitions; known ones stay."""
        self.schemas = {**schemas, **self.schemas}
        self.channels = {**channels, **self.channels}

    def add(self, found: Found, position: int) -> None:
        """Add a record at byte `position`."""
        record = found.record
        if isinstance(record, Chunk) and found.content is not None:
            self._add_chunk(record, found.content, position, len(found.data))
        elif isinstance(record, Schema):
            self.define({record.id: record}, {})
        elif isinstance(record, Channel):
            self.define({}, {record.id: record})
        elif isinstance(record, Attachment):
            self._attachments.append(
                AttachmentIndex(
                    offset=position,
                    length=len(found.data),
                    create_time=record.create_time,
                    log_time=record.log_time,
                    data_size=len(record.data),
                    name=record.name,
                    media_type=record.media_type,
                )
            )
        elif isinstance(record, Metadata):
            self._metadata.append(MetadataIndex(position, len(found.data), record.name))

    def stand_in(self) -> None:
        """Define the channels and schemas that are used and not defined."""
        for id in self._counts.keys() - self.channels.keys():
            self.channels[id] = Channel(id, f"lost/{id}", "", {}, 0)
        for channel in self.channels.values():
            if channel.schema_id and channel.schema_id not in self.schemas:
                self.schemas[channel.schema_id] = Schema(channel.schema_id, b"", "", "lost")

    def end(self, position: int) -> bytes:
        """DataEnd, summary, footer and magic, for a file whose data end at byte `position`."""
        data_end = written(DataEnd(0))
        start = position + len(data_end)
        groups: tuple[tuple[Opcode, list[McapRecord]], ...] = (
            (Opcode.SCHEMA, [*self.schemas.values()]),
            (Opcode.CHANNEL, [*self.channels.values()]),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, [*self._chunks]),
            (Opcode.ATTACHMENT_INDEX, [*self._attachments]),
            (Opcode.METADATA_INDEX, [*self._metadata]),
        )
        builder, offsets = RecordBuilder(), []
        for opcode, records in groups:
            begin = builder.count
            for record in records:
                record.write(builder)
            if records:
                offsets.append(SummaryOffset(opcode, start + begin, builder.count - begin))
        offsets_start = start + builder.count
        for offset in offsets:
            offset.write(builder)
        summary = builder.end()
        footer = written(Footer(start, offsets_start, 0))[:-4]
        crc = zlib.crc32(footer, zlib.crc32(summary))
        return data_end + summary + footer + struct.pack("<I", crc) + MAGIC

    def _add_chunk(self, chunk: Chunk, content: ChunkContent, position: int, length: int) -> None:
        self.define(content.schemas, content.channels)
        sizes = {id: len(written(index)) for id, index in content.indexes.items()}
        offset = position + length - sum(sizes.values())
        index = ChunkIndex(
            message_start_time=chunk.message_start_time,
            message_end_time=chunk.message_end_time,
            chunk_start_offset=position,
            chunk_length=offset - position,
            message_index_offsets={},
            message_index_length=sum(sizes.values()),
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            uncompressed_size=chunk.uncompressed_size,
        )
        for id, size in sizes.items():
            index.message_index_offsets[id] = offset
            offset += size
        self._chunks.append(index)
        self._counts.update({id: len(index.records) for id, index in content.indexes.items()})
        if content.messages:
            times_ns = [*self._times_ns, chunk.message_start_time, chunk.message_end_time]
            self._times_ns = [min(times_ns), max(times_ns)]

    def _statistics(self) -> Statistics:
        begin, end = self._times_ns or (0, 0)
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self.channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            metadata_count=len(self._metadata),
            message_start_time=begin,
            message_end_time=end,
            schema_count=len(self.schemas),
        )


def is_finished(path: Path) -> bool:
    """Whether the file ends with an intact summary, footer and magic."""
    end_bytes = _FOOTER.size + len(MAGIC)
    size = path.stat().st_size
    if size < len(MAGIC) + end_bytes:
        return False
    with path.open("rb") as stream:
        stream.seek(-end_bytes, 2)
        end = stream.read()
        opcode, _, summary_start, _, crc = _FOOTER.unpack_from(end)
        if not end.endswith(MAGIC) or opcode != Opcode.FOOTER:
            return False
        if crc == 0:  # no checksum
            return True
        if not 0 < summary_start <= size - end_bytes:
            return False
        stream.seek(summary_start)
        summed = stream.read(size - summary_start - len(MAGIC) - 4)
    return zlib.crc32(summed) == crc
