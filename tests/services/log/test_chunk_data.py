"""Forged logs: a few megabytes that unpack to half a gigabyte."""

import struct
import tracemalloc
from functools import partial

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Message, MessageIndex

from hsslam_node.errors import UserError
from hsslam_proto import topics
from hsslam_services.commands.log.trim import trim
from hsslam_services.log.channel_copies import CHANNELS, LIBRARY
from hsslam_services.log.file_index import FileIndex
from hsslam_services.log.reading.reader import bus_messages
from hsslam_services.log.recovery import recover
from hsslam_services.log.whole_records import MAGIC, ChunkContent, Found, written

_ZEROS = bytes(2**22)
_PIECES = 128
_CHANNEL = Channel(1, topics.POSE.key("r"), "msgpack", {}, 0)
_GOOD = written(_CHANNEL, Message(1, 1, b"pose", 1, 0))
_HEAD = struct.pack("<BQHIQQ", Opcode.MESSAGE, 22 + _PIECES * len(_ZEROS), 1, 0, 1, 1)


def _forged(packer) -> bytes:
    """A message of zeros, packed piece by piece."""
    pieces = [_HEAD, *(_ZEROS for _ in range(_PIECES))]
    return b"".join(packer.compress(piece) for piece in pieces) + packer.flush()


def _forged_lz4() -> bytes:
    packer = lz4.frame.LZ4FrameCompressor()
    return packer.begin() + _forged(packer)


def _forged_zstd(tells_size: bool) -> bytes:
    size = len(_HEAD) + _PIECES * len(_ZEROS) if tells_size else -1
    return _forged(zstandard.ZstdCompressor().compressobj(size=size))


_FORGED = [
    pytest.param("lz4", _forged_lz4, True, id="lz4"),
    pytest.param("lz4", _forged_lz4, False, id="lz4 without an index"),
    pytest.param("zstd", partial(_forged_zstd, False), True, id="zstd"),
    pytest.param("zstd", partial(_forged_zstd, True), True, id="zstd that tells its size"),
]


def _chunk(compression: str, data: bytes) -> Chunk:
    return Chunk(compression, data, 1, 1, 0, len(_GOOD))  # the size is a lie


def _write(path, *records, has_index=True) -> None:
    """A finished log of these records."""
    index, content = FileIndex(), MAGIC + written(Header("", LIBRARY))
    index.define({}, {1: _CHANNEL})
    messages = ChunkContent({}, {}, [], {1: MessageIndex(1, [(1, len(written(_CHANNEL)))])})
    for record in records:
        data = written(record, *(messages.indexes.values() if isinstance(record, Chunk) else ()))
        if has_index:
            is_chunk = isinstance(record, Chunk)
            found = Found(0, len(data), data, record, messages if is_chunk else None, True)
            index.add(found, len(content))
        content += data
    path.write_bytes(content + index.end(len(content)))


@pytest.fixture
def peak_bytes():
    """Returns the most memory that was in use since the test began, bytes."""
    tracemalloc.start()
    yield lambda: tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()


@pytest.mark.parametrize(("compression", "packed", "has_index"), _FORGED)
def test_a_forged_chunk_is_one_line_and_takes_little_memory(
    tmp_path, peak_bytes, compression, packed, has_index
):
    path = tmp_path / "run.mcap"
    _write(path, _chunk(compression, packed()), has_index=has_index)
    with pytest.raises(UserError, match=r"run\.mcap: damaged"):
        list(bus_messages([path]))
    with pytest.raises(UserError, match=r"run\.mcap: damaged"):
        trim([path], tmp_path / "short.mcap", 0.0, None)
    assert not (tmp_path / "short.mcap").exists()
    assert peak_bytes() < 300e6


def test_recovery_leaves_out_what_is_forged_and_keeps_the_rest(tmp_path, peak_bytes):
    path, good = tmp_path / "run.mcap", _chunk("lz4", lz4.frame.compress(_GOOD))
    forged = _chunk("zstd", _forged_zstd(tells_size=True))
    copies = Attachment(1, 1, CHANNELS, "application/octet-stream", _forged_lz4())
    _write(path, good, forged, copies, good)
    recovered = recover(path)
    assert (recovered.counts, recovered.gaps) == ({_CHANNEL.topic: 2}, 1)
    _write(path, forged, has_index=False)
    assert recover(path).counts == {}
    assert peak_bytes() < 300e6


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_chunk_that_is_cut_short_is_one_line(tmp_path, compression):
    packed = lz4.frame.compress(_GOOD) if compression == "lz4" else zstandard.compress(_GOOD)
    path = tmp_path / "run.mcap"
    _write(path, _chunk(compression, packed))
    assert [logged.payload for logged in bus_messages([path])] == [b"pose"]
    for torn in (packed[:-6], packed[:3], b""):
        _write(path, _chunk(compression, torn))
        with pytest.raises(UserError, match=r"run\.mcap: damaged"):
            list(bus_messages([path]))
