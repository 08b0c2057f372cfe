"""The MCAP log of a run: the bus as it was, and a layer that public viewers draw."""

import shutil
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from hsslam_node import __version__
from hsslam_node.proto.foxglove import VizMessage
from hsslam_node.proto.json_schemas import json_schema
from hsslam_node.proto.topics import Topic
from hsslam_node.services.patient_file import PatientFile

RESERVE_BYTES = 64 * 2**20
RUN_METADATA = "hsslam.run"
_FLUSH_S = 1.0
_CHUNK_BYTES = 2**20


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
        self._file = PatientFile(path)
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
