"""Writes one MCAP file of the log of a run: bus layer and Foxglove layer."""

import shutil
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from hsslam_node import __version__
from hsslam_proto.foxglove.visualisation import VizMessage
from hsslam_proto.schema.json_schemas import json_schema
from hsslam_proto.topics import Topic
from hsslam_services.log.channel_copies import LIBRARY, RUN_METADATA, ChannelCopies
from hsslam_services.log.resilient_file import ResilientFile

RESERVE_BYTES = 64 * 2**20
_FLUSH_S = 1.0
_CHUNK_BYTES = 2**20
_MOST_PENDING_BYTES = 64 * 2**20
_ROOM_AGAIN = 1.5  # times the reserve


class McapLog:
    """An open log file; `write` adds a message of the bus, `write_viz` one of the /viz layer.

    Bus channels hold the payload as published (topic = zenoh key, encoding `msgpack`, JSON Schema);
    `counts`: messages by topic. A message is in the file 1 s later, and then synced to disk, so that a power
    cut loses 2 s. `metadata` becomes the record `hsslam.run` at the start.
    `space_is_short` is true while less than `reserve_bytes` are free: then log nothing large. If too much
    data waits for a full disk, messages are refused and counted in `refused`.
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
        self.refused = 0
        self.space_is_short = False
        self._robot = robot
        self._reserve_bytes = RESERVE_BYTES if reserve_bytes is None else reserve_bytes
        self._file = ResilientFile(path)
        stream = cast(IO[Any], self._file)
        self._writer = Writer(stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.LZ4)
        self._writer.start(profile="", library=f"{LIBRARY} {__version__}")
        if metadata:
            self._writer.add_metadata(RUN_METADATA, dict(metadata))
        self._copies = ChannelCopies(self._writer)
        self._channels: dict[str, int] = {}
        self._viz_sequence: Counter[str] = Counter()
        self._flushed_s = time.monotonic()
        self._check_space()

    def write(
        self, topic: Topic, payload: bytes, log_ns: int, publish_ns: int, sequence: int
    ) -> bool:
        """Log one message of the bus; times are wall clock, `log_ns`: its arrival. False: refused."""
        if self._is_full():
            self.refused += 1
            return False
        key = topic.key(self._robot)
        if key not in self._channels:
            self._channels[key] = self._copies.register(
                key, "msgpack", topic.schema, "jsonschema", json_schema(topic)
            )
        self._writer.add_message(self._channels[key], log_ns, payload, publish_ns, sequence)
        self.counts[topic.name] += 1
        return True

    def write_viz(self, message: VizMessage, log_ns: int, stamp_ns: int) -> None:
        """Log one message of the /viz layer; `log_ns`: its arrival, `stamp_ns`: of what it shows."""
        if self._is_full():
            return
        if message.topic not in self._channels:
            self._channels[message.topic] = self._copies.register(
                message.topic,
                "protobuf",
                message.schema.DESCRIPTOR.full_name,
                "protobuf",
                build_file_descriptor_set(message.schema).SerializeToString(),
            )
        sequence = self._viz_sequence[message.topic]
        self._viz_sequence[message.topic] += 1
        self._writer.add_message(
            self._channels[message.topic], log_ns, message.payload, stamp_ns, sequence
        )

    @property
    def bytes_written(self) -> int:
        """Size of the file so far, without data that is not flushed."""
        return self._file.tell()

    @property
    def pending_bytes(self) -> int:
        """Bytes that wait for room on a full disk; normally 0."""
        return self._file.pending_bytes

    @property
    def sync_error(self) -> str:
        """As in `ResilientFile`."""
        return self._file.sync_error

    @property
    def channel_keys(self) -> dict[int, str]:
        """Keys of the channels so far, by id."""
        return {id: key for key, id in self._channels.items()}

    def tick(self) -> bool:
        """Flush everything to the file once a second, and then return True; call this often."""
        if time.monotonic() - self._flushed_s < _FLUSH_S:
            return False
        self._flushed_s = time.monotonic()
        self._writer.flush()
        if not self._file.pending_bytes:
            self._copies.write_if_due()
        self._file.sync()
        self._check_space()
        return True

    def finish(self) -> int:
        """Write the index; returns the number of bytes lost to a full disk. A thread syncs and closes."""
        self._writer.finish()
        self._file.release()
        return self._file.pending_bytes

    def wait_until_closed(self) -> None:
        """Wait until all of a finished log is on the disk."""
        self._file.wait_until_closed()

    def close(self) -> int:
        """`finish`, and wait until all is on the disk."""
        lost_bytes = self.finish()
        self.wait_until_closed()
        return lost_bytes

    def _is_full(self) -> bool:
        return self._file.pending_bytes > _MOST_PENDING_BYTES

    def _check_space(self) -> None:
        free_bytes = shutil.disk_usage(self.path.parent).free
        enough_bytes = self._reserve_bytes * (_ROOM_AGAIN if self.space_is_short else 1)
        self.space_is_short = self._file.pending_bytes > 0 or free_bytes < enough_bytes
