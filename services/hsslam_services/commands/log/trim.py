"""`hsslam-log trim`: copies a part of a log into a new log."""

import math
from pathlib import Path

from mcap.reader import McapReader
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer

from hsslam_node import __version__
from hsslam_node.durable_file import durable_file
from hsslam_node.errors import UserError
from hsslam_services.commands.log.progress import LogProgress, log_progress
from hsslam_services.log.parts import is_part
from hsslam_services.log.reading.reader import log_reader, log_span_ns, messages_between

_MOST_NS = 2.0**63  # later than every message


def trim(files: list[Path], out: Path, start_s: float, end_s: float | None) -> int:
    """Copy all messages from `start_s` to before `end_s`, s after the earliest one, and the metadata of the
    parts of a log into one file; returns the number of messages. Writes the whole file or none.

    Raises:
        UserError: there is no message in that time, a part is damaged, or `out` is one of the parts or
            has the name of one (run.mcap, run.1.mcap), is a folder, or cannot be written.
    """
    try:
        if out.exists() and any(out.samefile(path) for path in files):
            raise UserError(f"{out}: is the log itself: expected another file")
        if is_part(out.resolve().name) and out.is_file():
            raise UserError(f"{out}: is a part of a log: expected a new file, such as short.mcap")
        if out.is_dir():
            raise UserError(f"{out}: is a folder: expected a file, such as short.mcap")
        with durable_file(out) as copy:
            with copy.open("wb") as stream:
                trimmed = _Trimmed(Writer(stream, compression=CompressionType.LZ4))
                count = trimmed.copy(files, _ns(start_s), _ns(math.inf if end_s is None else end_s))
            if count == 0:
                stretch = f"{start_s:g} to {'its end' if end_s is None else f'{end_s:g} s'}"
                raise UserError(
                    f"{files[0]}: no message from {stretch}: expected a time within the log"
                )
    except OSError as error:
        raise UserError(f"{out}: {error.strerror}: expected a file that can be written") from None
    return count


class _Trimmed:
    """A writer that registers each schema and channel of all parts once."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[str, int] = {}
        self._metadata: set[str] = set()  # names

    def copy(self, files: list[Path], start_after_ns: int, end_after_ns: int) -> int:
        self._writer.start(library=f"hsslam-node {__version__}")
        with log_progress("trimmed", files) as progress:
            count = self._copy(files, start_after_ns, end_after_ns, progress)
        self._writer.finish()
        return count

    def _copy(
        self,
        files: list[Path],
        start_after_ns: int,
        end_after_ns: int,
        progress: LogProgress,
    ) -> int:
        count = 0
        start_ns, _ = log_span_ns(files)
        low, high = start_ns + start_after_ns, start_ns + end_after_ns
        for path in files:
            with log_reader(path) as reader:
                self._copy_metadata(reader)
            # in the order of the file: their times go back if the clock was set back
            for schema, channel, message in messages_between(path, low, high):
                self._writer.add_message(
                    self._channel(channel, schema),
                    message.log_time,
                    message.data,
                    message.publish_time,
                    message.sequence,
                )
                progress.move(message.log_time)
                count += 1
        return count

    def _copy_metadata(self, reader: McapReader) -> None:
        """Each part has the same records, but a recovered part may have lost them."""
        for record in reader.iter_metadata():
            if record.name not in self._metadata:
                self._metadata.add(record.name)
                self._writer.add_metadata(record.name, record.metadata)

    def _channel(self, channel: Channel, schema: Schema | None) -> int:
        if channel.topic not in self._channels:
            self._channels[channel.topic] = self._writer.register_channel(
                channel.topic, channel.message_encoding, self._schema(schema), channel.metadata
            )
        return self._channels[channel.topic]

    def _schema(self, schema: Schema | None) -> int:
        if schema is None:
            return 0
        key = (schema.name, schema.encoding, schema.data)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(*key)
        return self._schemas[key]


def _ns(seconds: float) -> int:
    return round(min(1e9 * seconds, _MOST_NS))
