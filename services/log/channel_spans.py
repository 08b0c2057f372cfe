"""When each channel of a log begins and ends, without reading its messages."""

from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.records import ChunkIndex, MessageIndex
from mcap.summary import Summary

_OPCODE_AND_LENGTH_BYTES = 1 + 8


def channel_spans(stream: IO[bytes], summary: Summary) -> dict[int, float]:
    """Seconds from the first to the last message of each channel, by its id.

    Read are the message indexes of the first and the last chunk that hold a channel. Messages outside
    of chunks are not seen.
    """
    first: dict[int, ChunkIndex] = {}
    last: dict[int, ChunkIndex] = {}
    for chunk in sorted(summary.chunk_indexes, key=lambda chunk: chunk.message_start_time):
        for channel in chunk.message_index_offsets:
            first.setdefault(channel, chunk)
            last[channel] = chunk
    return {
        channel: (max(_times(stream, last[channel], channel), default=0) - begin) / 1e9
        for channel, chunk in first.items()
        if (begin := min(_times(stream, chunk, channel), default=0))
    }


def _times(stream: IO[bytes], chunk: ChunkIndex, channel: int) -> list[int]:
    """Log times of the channel's messages in this chunk, ns."""
    stream.seek(chunk.message_index_offsets[channel] + _OPCODE_AND_LENGTH_BYTES)
    return [time_ns for time_ns, _ in MessageIndex.read(ReadDataStream(stream)).records]
