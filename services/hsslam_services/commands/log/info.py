"""`hsslam-log info`: what one log file holds, and when each channel begins and ends."""

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.records import ChunkIndex, MessageIndex, Statistics
from mcap.summary import Summary
from rich.table import Table
from rich.text import Text

from hsslam_node.presets import PRESETS
from hsslam_services.log.mcap_writer import RUN_METADATA
from hsslam_services.log.reader import log_reader
from hsslam_services.run.options import ServeOptions

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


def log_info(path: Path) -> Iterator[Text | Table]:
    """The file in a line, the run in another, its topics in a table.

    Raises:
        UserError: the file is damaged.
    """
    with log_reader(path) as reader, path.open("rb") as stream:
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise ValueError("no statistics")
        about = {record.name: record.metadata for record in reader.iter_metadata()}
        spans_s = channel_spans(stream, summary)
    statistics = summary.statistics
    began = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(statistics.message_start_time / 1e9))
    yield Text(
        f"{path}: finished, {path.stat().st_size / 1e6:.1f} MB, {_seconds(statistics):.1f} s from "
        f"{began} UTC, {statistics.message_count} messages"
    )
    run = about.get(RUN_METADATA)
    if run is not None:
        yield Text(_run_line(run))
    yield _topics(summary, statistics, spans_s)


def _topics(summary: Summary, statistics: Statistics, spans_s: Mapping[int, float]) -> Table:
    table = Table("topic", "schema")
    table.add_column("messages", justify="right")
    table.add_column("rate, Hz", justify="right")
    for channel in sorted(summary.channels.values(), key=lambda channel: channel.topic):
        count = statistics.channel_message_counts.get(channel.id, 0)
        schema = summary.schemas.get(channel.schema_id)
        seconds = spans_s.get(channel.id, 0.0)
        rate = f"{(count - 1) / seconds:.2f}" if seconds > 0 and count > 2 else "-"
        table.add_row(channel.topic, schema.name if schema else "-", str(count), rate)
    return table


def _seconds(statistics: Statistics) -> float:
    return (statistics.message_end_time - statistics.message_start_time) / 1e9


def _run_line(run: Mapping[str, str]) -> str:
    line = f"run {run.get('run_id', '?')} of hsslam-node {run.get('version', '?')}"
    try:
        given = msgspec.json.decode(run.get("options", "{}").encode())
        preset = PRESETS.get(given.get("preset"), ServeOptions().slam)
        usual = msgspec.json.decode(msgspec.json.encode(ServeOptions(slam=preset)))
        words = list(_differences(given, usual, "--"))
    except (msgspec.MsgspecError, AttributeError):
        return f"{line}, options of another version"
    return f"{line}: {' '.join(words) if words else 'all options as by default'}"


def _differences(given: Any, usual: Any, name: str) -> Iterator[str]:
    """Options, as one would write them, that are not as by default."""
    for key, value in given.items():
        default = usual.get(key) if isinstance(usual, Mapping) else None
        dashed = name + key.replace("_", "-")
        if isinstance(value, Mapping):
            yield from _differences(value, default or {}, f"{dashed}.")
        elif value != default:
            yield _written(dashed, value)


def _written(name: str, value: Any) -> str:
    if isinstance(value, bool):
        return name if value else name.replace("--", "--no-", 1)
    words = [str(item) for item in value] if isinstance(value, list) else [str(value)]
    return " ".join([name, *words])
