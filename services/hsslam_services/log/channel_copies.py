"""Copies of a log's schemas and channels, and the names of its metadata."""

import time

import lz4.frame
from mcap.records import Channel, Schema
from mcap.writer import Writer

from hsslam_services.log.whole_records import written

LIBRARY = "hsslam-node"  # prefix of `library` in the header of our files
RUN_METADATA = "hsslam.run"
CHANNELS = "hsslam.channels"  # attachment: records of schemas and channels in an LZ4 frame
_EVERY_S = 10.0


class ChannelCopies:
    """Writes copies of a log's schemas and channels as attachments, which have a checksum.

    Only the chunk in which a channel begins defines it. If that chunk is damaged, recovery reads the other
    chunks with a copy.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._records = b""
        self._are_new = False
        self._written_s = time.monotonic()

    def register(
        self, topic: str, encoding: str, schema_name: str, schema_encoding: str, schema: bytes
    ) -> int:
        """Begin a channel with its own schema; returns the id of the channel."""
        schema_id = self._writer.register_schema(schema_name, schema_encoding, schema)
        channel_id = self._writer.register_channel(topic, encoding, schema_id)
        self._records += written(
            Schema(schema_id, schema, schema_encoding, schema_name),
            Channel(channel_id, topic, encoding, {}, schema_id),
        )
        self._are_new = True
        return channel_id

    def write_if_due(self) -> None:
        """Write a copy after a channel has begun, and every 10 s; call it between two chunks."""
        now_s = time.monotonic()
        if not self._records or not (self._are_new or now_s - self._written_s >= _EVERY_S):
            return
        self._written_s, self._are_new = now_s, False
        data = lz4.frame.compress(self._records)
        now_ns = time.time_ns()
        self._writer.add_attachment(now_ns, now_ns, CHANNELS, "application/octet-stream", data)
