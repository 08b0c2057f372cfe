"""Unpacks the data of an MCAP file within a limit of memory: 1 MB of a forged file may hold 255 MB."""

from collections.abc import Iterator
from dataclasses import replace
from typing import IO

import lz4.frame
import zstandard
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

_MOST_BYTES = 2**28  # the largest message of a topic
# of larger data: a mesh drawn for Foxglove is larger than its message, but packs less well
_MOST_RATIO = 16
_PIECE_BYTES = 2**22


def unpacked_chunk(chunk: Chunk) -> Chunk:
    """The chunk without compression.

    Raises:
        ValueError: its data are damaged, or take more than 256 MiB and 16 times their size in the file.
        RuntimeError: as LZ4 reports damage.
    """
    match chunk.compression:
        case "lz4":
            return replace(chunk, compression="", data=unpacked_lz4(chunk.data))
        case "zstd":
            return replace(chunk, compression="", data=_unpacked_zstd(chunk.data))
    return chunk


def unpacked_lz4(data: bytes) -> bytes:
    """The content of an LZ4 frame; limits and errors as of `unpacked_chunk`."""
    unpacker = lz4.frame.LZ4FrameDecompressor()
    pieces, size = [unpacker.decompress(data, max_length=_PIECE_BYTES)], 0
    while True:
        size += len(pieces[-1])
        _expect_room(size, data)
        if unpacker.eof:
            return b"".join(pieces)
        if not pieces[-1]:
            raise ValueError("an LZ4 frame without its end")
        pieces.append(unpacker.decompress(b"", max_length=_PIECE_BYTES))


def messages_in_file(stream: IO[bytes]) -> Iterator[Message]:
    """All messages of a file in its order, without its index; checks all checksums.

    Raises:
        McapError, ValueError, ...: one of the errors of a damaged file.
    """
    stream.seek(0)
    for record in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
        if isinstance(record, Message):
            yield record
        elif isinstance(record, Chunk):
            for packed in breakup_chunk(unpacked_chunk(record), validate_crc=True):
                if isinstance(packed, Message):
                    yield packed


def _unpacked_zstd(data: bytes) -> bytes:
    try:
        _expect_room(zstandard.frame_content_size(data), data)  # -1: the frame does not tell it
        return zstandard.decompress(data, _most_bytes(data))
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from None


def _expect_room(size: int, data: bytes) -> None:
    most = _most_bytes(data)
    if size > most:
        raise ValueError(f"{len(data)} bytes that unpack to more than {most >> 20} MiB")


def _most_bytes(data: bytes) -> int:
    return max(_MOST_BYTES, _MOST_RATIO * len(data))
