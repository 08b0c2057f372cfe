"""Names of what a log says of itself, and its definitions of channels, kept in more than one place."""

import time

import lz4.frame
from mcap.records import Channel, Schema
from mcap.writer import Writer

from hsslam_services.log.whole_records import written

LIBRARY = "hsslam-node"  # how the library of our files begins
RUN_METADATA = "hsslam.run"
CHANNELS = "hsslam.channels"  # an attachment: schemas and channels as records, in an LZ4 frame
_EVERY_S = 10.0


class ChannelCopies:
    """Writes schemas and channels of a log again and again, as attachments: they carry a sum.

    A chunk has them for the channels only that begin in it. If it is damaged, recovery reads the other
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
        """Begin a channel with a schema of its own; its id."""
        schema_id = self._writer.register_schema(schema_name, schema_encoding, schema)
        channel_id = self._writer.register_channel(topic, encoding, schema_id)
        self._records += written(
            Schema(schema_id, schema, schema_encoding, schema_name),
            Channel(channel_id, topic, encoding, {}, schema_id),
        )
        self._are_new = True
        return channel_id

    def write_if_due(self) -> None:
        """Write a copy soon after a channel begins, and every 10 s; call it between two chunks."""
        now_s = time.monotonic()
        if not self._records or not (self._are_new or now_s - self._written_s >= _EVERY_S):
            return
        self._written_s, self._are_new = now_s, False
        data = lz4.frame.compress(self._records)
        now_ns = time.time_ns()
        self._writer.add_attachment(now_ns, now_ns, CHANNELS, "application/octet-stream", data)
