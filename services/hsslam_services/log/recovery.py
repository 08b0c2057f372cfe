"""Unfinished logs (SIGKILL, power cut) made readable, and what an earlier recorder has logged."""

import contextlib
import re
import struct
import threading
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from hsslam_services.bus.publisher import Report

MAGIC = b"\x89MCAP0\r\n"
_PART = re.compile(r"run(?:\.(\d+))?\.mcap")


@dataclass(frozen=True)
class Recovered:
    """What was found in a log: messages per channel topic, and which were there.

    `identities` has (topic, publish time ns, sequence) of each message.
    """

    counts: dict[str, int]
    identities: frozenset[tuple[str, int, int]]


def parts(run_dir: Path) -> list[Path]:
    """The parts of the log of a run, in order: run.mcap, run.1.mcap, ..."""
    found = [path for path in run_dir.glob("run*.mcap") if _PART.fullmatch(path.name)]
    return sorted(found, key=_number)


def next_part(run_dir: Path) -> Path:
    """Where the next part of the log of a run goes."""
    existing = parts(run_dir)
    if not existing:
        return run_dir / "run.mcap"
    return run_dir / f"run.{_number(existing[-1]) + 1}.mcap"


def is_finished(path: Path) -> bool:
    """Whether the file ends as a finished MCAP does."""
    if path.stat().st_size < 2 * len(MAGIC):
        return False
    with path.open("rb") as stream:
        stream.seek(-len(MAGIC), 2)
        return stream.read() == MAGIC


def recover(path: Path) -> Recovered:
    """Read every complete record; an unfinished file is replaced by an indexed one.

    Raises:
        OSError: no room for the copy (the original stays).
    """
    if is_finished(path):
        return _scan(_records(path))
    copy = path.with_name(f".{path.name}.recovering")
    try:
        with copy.open("wb") as stream:
            writer = Writer(stream, compression=CompressionType.LZ4)
            writer.start(library="hsslam-node recovery")
            recovered = _scan(_copied(_records(path), writer))
            writer.finish()
        copy.replace(path)
    except OSError:
        copy.unlink(missing_ok=True)
        raise
    return recovered


def _scan(records: Iterator[McapRecord]) -> Recovered:
    topics: dict[int, str] = {}
    counts: dict[str, int] = {}
    identities: set[tuple[str, int, int]] = set()
    for record in records:
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            topic = topics[record.channel_id]
            counts[topic] = counts.get(topic, 0) + 1
            identities.add((topic, record.publish_time, record.sequence))
    return Recovered(counts, frozenset(identities))


def _records(path: Path) -> Iterator[McapRecord]:
    """Records up to the first that is cut off or damaged."""
    with path.open("rb") as stream:
        records = StreamReader(stream, validate_crcs=True).records
        # a torn record fails in whatever parses it: struct, LZ4 (RuntimeError) or the CRC check
        with contextlib.suppress(McapError, struct.error, ValueError, RuntimeError, EOFError):
            yield from records


def _copied(records: Iterator[McapRecord], writer: Writer) -> Iterator[McapRecord]:
    """The same records, each written on the way."""
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    for record in records:
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
            )
        elif isinstance(record, Message):
            writer.add_message(
                channels[record.channel_id],
                record.log_time,
                record.data,
                record.publish_time,
                record.sequence,
            )
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        yield record


def _number(path: Path) -> int:
    match = _PART.fullmatch(path.name)
    return int(match.group(1) or 0) if match else 0


class EarlierParts:
    """Makes the parts readable in a thread of its own, beside the new recording.

    `found` has what they hold once `is_done`. `tell(level, text)` takes its events.
    """

    def __init__(self, run_dir: Path, tell: Report) -> None:
        self.found = Recovered({}, frozenset())
        self._tell = tell
        self._parts = parts(run_dir)
        self._thread: threading.Thread | None = None
        if self._parts and not is_finished(self._parts[-1]):
            self._thread = threading.Thread(target=self._run, name="recovery", daemon=True)
            self._thread.start()

    def is_done(self) -> bool:
        """Whether nothing is left to be made readable."""
        return self._thread is None or not self._thread.is_alive()

    def join(self) -> None:
        """Wait until it is done."""
        if self._thread is not None:
            self._thread.join()

    def has(self, topic: str, publish_ns: int, sequence: int) -> bool:
        """Whether a message is there already; `topic`: its key."""
        return (topic, publish_ns, sequence) in self.found.identities

    def _run(self) -> None:
        counts: Counter[str] = Counter()
        identities: set[tuple[str, int, int]] = set()
        for path in self._parts:
            try:
                recovered = recover(path)
            except OSError as error:
                self._tell("error", f"{path}: {error.strerror}: left unfinished")
                continue
            counts.update(recovered.counts)
            identities |= recovered.identities
        self.found = Recovered(dict(counts), frozenset(identities))
        self._tell("info", f"{self._parts[-1].name}: recovered {counts.total()} messages")
