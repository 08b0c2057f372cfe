"""The MCAP log of a run (bus layer and Foxglove layer), on a file that survives a full disk."""

import contextlib
import errno
import fcntl
import os
import shutil
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from hsslam_node import __version__
from hsslam_proto.foxglove import VizMessage
from hsslam_proto.json_schemas import json_schema
from hsslam_proto.topics import Topic

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
RESERVE_BYTES = 64 * 2**20
RUN_METADATA = "hsslam.run"
_FLUSH_S = 1.0
_CHUNK_BYTES = 2**20


class ResilientFile:
    """Sequential output that keeps in memory, in order, what a full disk refuses, and tries again.

    The file is locked (flock) while it is open, so that others see that it grows.
    Positions (`tell`) count what was accepted, so an index written through it stays right.
    Errors other than a full disk are raised as OSError.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._pending = bytearray()
        self._position = 0

    @property
    def pending_bytes(self) -> int:
        """Bytes that wait for room on the disk; 0 in health."""
        return len(self._pending)

    def write(self, data: bytes) -> int:
        """Accept all of `data`."""
        self._position += len(data)
        if self._pending:
            self._pending += data
            self.flush()
            return len(data)
        view = memoryview(data)
        while view:
            written = self._try_write(view)
            if written == 0:
                self._pending += view
                break
            view = view[written:]
        return len(data)

    def flush(self) -> None:
        """Try to write what waits."""
        while self._pending:
            written = self._try_write(self._pending)
            if written == 0:
                return
            del self._pending[:written]

    def tell(self) -> int:
        """Bytes accepted so far."""
        return self._position

    def close(self) -> None:
        """Try once more, then close; `pending_bytes` are lost."""
        self.flush()
        os.close(self._fd)

    def _try_write(self, data: bytes | bytearray | memoryview) -> int:
        try:
            return os.write(self._fd, data)
        except OSError as error:
            if error.errno in _FULL:
                return 0
            raise


class McapLog:
    """An open log file; `write` adds a message of the bus, `write_viz` one of the /viz layer.

    Bus channels carry the payload as it was published (topic = zenoh key, encoding `msgpack`, JSON
    Schema); `counts` has the messages of each topic. Everything is on disk 1 s later.
    `metadata` becomes the record `hsslam.run` at the start. `space_is_short` turns true when less than
    `reserve_bytes` are free: then log no more frames.
    """

    def __init__(
        self,
        path: Path,
        robot: str,
        reserve_bytes: int | None = None,
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        self.path = path
        self.counts: Counter[str] = Counter()
        self.space_is_short = False
        self._robot = robot
        self._reserve_bytes = RESERVE_BYTES if reserve_bytes is None else reserve_bytes
        self._file = ResilientFile(path)
        stream = cast(IO[Any], self._file)
        self._writer = Writer(stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.LZ4)
        self._writer.start(profile="", library=f"hsslam-node {__version__}")
        if metadata:
            self._writer.add_metadata(RUN_METADATA, dict(metadata))
        self._channels: dict[str, int] = {}
        self._viz_sequence: Counter[str] = Counter()
        self._flushed_s = time.monotonic()
        self._check_space()

    def write(
        self, topic: Topic, payload: bytes, log_ns: int, publish_ns: int, sequence: int
    ) -> None:
        """Log one message of the bus; times are wall clock, `log_ns` is its arrival."""
        key = topic.key(self._robot)
        if key not in self._channels:
            schema = self._writer.register_schema(topic.schema, "jsonschema", json_schema(topic))
            self._channels[key] = self._writer.register_channel(key, "msgpack", schema)
        self._writer.add_message(self._channels[key], log_ns, payload, publish_ns, sequence)
        self.counts[topic.name] += 1

    def write_viz(self, message: VizMessage, stamp_ns: int) -> None:
        """Log one message of the /viz layer."""
        if message.topic not in self._channels:
            schema = self._writer.register_schema(
                message.schema.DESCRIPTOR.full_name,
                "protobuf",
                build_file_descriptor_set(message.schema).SerializeToString(),
            )
            channel = self._writer.register_channel(message.topic, "protobuf", schema)
            self._channels[message.topic] = channel
        sequence = self._viz_sequence[message.topic]
        self._viz_sequence[message.topic] += 1
        self._writer.add_message(
            self._channels[message.topic], stamp_ns, message.payload, stamp_ns, sequence
        )

    @property
    def bytes_written(self) -> int:
        """Size of the file so far, without what the next flush adds."""
        return self._file.tell()

    def tick(self) -> None:
        """Call it often; once a second it brings everything to the disk."""
        if time.monotonic() - self._flushed_s >= _FLUSH_S:
            self._flushed_s = time.monotonic()
            self._writer.flush()
            self._check_space()

    def close(self) -> int:
        """Write the index and close; returns the bytes that a full disk refused (0 in health)."""
        self._writer.finish()
        self._file.close()
        return self._file.pending_bytes

    def _check_space(self) -> None:
        free_bytes = shutil.disk_usage(self.path.parent).free
        self.space_is_short = self._file.pending_bytes > 0 or free_bytes < self._reserve_bytes
