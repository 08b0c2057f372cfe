"""`hsslam-log info`: contents of a log over all its parts, and the rates of its topics."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.records import ChunkIndex, MessageIndex, Statistics
from mcap.summary import Summary
from rich.table import Table
from rich.text import Text

from hsslam_node.presets import PRESETS
from hsslam_services.commands.options.option_table import flag_of, off_flag_of
from hsslam_services.log.channel_copies import RUN_METADATA
from hsslam_services.log.reading.reader import log_reader
from hsslam_services.run.options import ServeOptions

_OPCODE_AND_LENGTH_BYTES = 1 + 8


def channel_spans(stream: IO[bytes], summary: Summary) -> dict[int, float]:
    """Seconds from the first to the last message of each channel, by its id.

    It reads the message indexes of the first and the last chunk of each channel, so it ignores messages
    outside of chunks.
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


@dataclass
class _Channel:
    """Messages of a topic; `span_s`: seconds from the first to the last in each part, summed."""

    schema: str
    count: int = 0
    span_s: float = 0.0


def log_info(files: list[Path]) -> Iterator[Text | Table]:
    """A line for the parts of a log, a line for the run, and a table of the topics of all parts.

    Raises:
        UserError: a file is damaged.
    """
    channels: dict[str, _Channel] = {}
    found: list[Statistics] = []
    run: Mapping[str, str] | None = None
    for path in files:
        with log_reader(path) as reader, path.open("rb") as stream:
            summary = reader.get_summary()
            if summary is None or summary.statistics is None:
                raise ValueError("no statistics")
            about = {record.name: record.metadata for record in reader.iter_metadata()}
            run = run or about.get(RUN_METADATA)
            _add_channels(channels, summary, channel_spans(stream, summary))
            found.append(summary.statistics)
    yield Text(_files_line(files, found))
    if run is not None:
        yield Text(_run_line(run))
    yield _topics(channels)


def _add_channels(
    channels: dict[str, _Channel], summary: Summary, spans_s: Mapping[int, float]
) -> None:
    counts = summary.statistics.channel_message_counts if summary.statistics else {}
    for channel in summary.channels.values():
        schema = summary.schemas.get(channel.schema_id)
        sofar = channels.setdefault(channel.topic, _Channel(schema.name if schema else "-"))
        sofar.count += counts.get(channel.id, 0)
        sofar.span_s += spans_s.get(channel.id, 0.0)


def _files_line(files: list[Path], found: list[Statistics]) -> str:
    size_mb = sum(path.stat().st_size for path in files) / 1e6
    count = sum(statistics.message_count for statistics in found)
    logged = [statistics for statistics in found if statistics.message_count]
    begin_ns = min((statistics.message_start_time for statistics in logged), default=0)
    end_ns = max((statistics.message_end_time for statistics in logged), default=0)
    began = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(begin_ns / 1e9))
    where = (
        f"{files[0]}" if len(files) == 1 else f"{files[0]} to {files[-1].name}, {len(files)} parts"
    )
    return (
        f"{where}: finished, {size_mb:.1f} MB, {(end_ns - begin_ns) / 1e9:.1f} s from {began} UTC, "
        f"{count} messages"
    )


def _topics(channels: Mapping[str, _Channel]) -> Table:
    table = Table()
    for name in ("topic", "schema"):
        table.add_column(name, overflow="fold")
    table.add_column("messages", justify="right")
    table.add_column("rate, Hz", justify="right")
    for topic, channel in sorted(channels.items()):
        has_rate = channel.span_s > 0 and channel.count > 2
        rate = f"{(channel.count - 1) / channel.span_s:.2f}" if has_rate else "-"
        table.add_row(topic, channel.schema, str(channel.count), rate)
    return table


def _run_line(run: Mapping[str, str]) -> str:
    line = f"run {run.get('run_id', '?')} of hsslam-node {run.get('version', '?')}"
    try:
        given = msgspec.json.decode(run.get("options", "{}").encode())
        preset = PRESETS.get(given.get("preset"), ServeOptions().slam)
        usual = msgspec.json.decode(msgspec.json.encode(ServeOptions(slam=preset)))
        words = list(_differences(given, usual, ""))
    except (msgspec.MsgspecError, AttributeError):
        return f"{line}, options of another version"
    return f"{line}: {' '.join(words) if words else 'default options'}"


def _differences(given: Any, usual: Any, group: str) -> Iterator[str]:
    """Options that differ from the default, as on the command line; `group`: prefix of their names."""
    for key, value in given.items():
        default = usual.get(key) if isinstance(usual, Mapping) else None
        if isinstance(value, Mapping):
            yield from _differences(value, default or {}, f"{group}{key}.")
        elif value != default:
            yield _written(f"{group}{key}", value)


def _written(name: str, value: Any) -> str:
    if isinstance(value, bool):
        return flag_of(name) if value else off_flag_of(name)
    words = [str(item) for item in value] if isinstance(value, list) else [str(value)]
    return " ".join([flag_of(name), *words])
