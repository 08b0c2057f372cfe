"""Saves what a recorder has logged, in a small file beside the log, for the next recorder after a crash."""

import contextlib
import os
import struct
import zlib
from collections import Counter, OrderedDict
from collections.abc import Mapping
from pathlib import Path

import msgspec

from hsslam_proto.envelope import Envelope
from hsslam_services.log.parts import part_number, parts
from hsslam_services.log.whole_records import Found, whole_records

_FILE = ".run.mcap.recorded"
_HEAD = struct.Struct("<II")  # length and CRC of the data
_MOST_SENDERS = 256
Identity = tuple[str, int, int]  # key, publish time ns, sequence


class _Saved(msgspec.Struct, frozen=True, array_like=True):
    """State of the log up to byte `position` of `part`; `channels`: keys of its channels by id."""

    run_id: str
    part: str
    position: int
    channels: dict[int, str]
    counts: dict[str, int]
    next_sequence: list[tuple[str, int, int]]  # key, publisher, sequence
    dropped: dict[str, int]  # by key


class RecordedSoFar:
    """Number of logged messages by topic key, and the next sequence number of each publisher.

    A restarted recorder reads the saved state, and from there to the end of the log, about a second of it.
    `has` is true for messages that the previous recorder logged; `add` takes messages logged now; `dropped`
    counts by key those that earlier recorders dropped. Knows the newest 256 publishers.
    """

    def __init__(self, run_dir: Path, run_id: str) -> None:
        self.counts: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self._run_id = run_id
        self._next: OrderedDict[tuple[str, int], int] = OrderedDict()
        self._unplaced: set[Identity] = set()
        self._read(run_dir)
        self._before = dict(self._next)
        self._path = run_dir / _FILE
        self._fd = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)

    def has(self, key: str, envelope: Envelope | None) -> bool:
        """Whether the previous recorder has logged this message."""
        if envelope is None:
            return False
        if envelope.sequence < self._before.get((key, envelope.publisher), 0):
            return True
        identity = (key, envelope.publish_ns, envelope.sequence)
        if identity not in self._unplaced:
            return False
        self._unplaced.discard(identity)
        self._follow(key, envelope)
        return True

    def awaited(self, key: str) -> dict[int, int]:
        """Next sequence number after the log of each publisher that the previous recorder knew."""
        awaited = {publisher: n for (name, publisher), n in self._before.items() if name == key}
        if awaited and (logged := self._logged_at_end(key)):
            newest = next(reversed(awaited))
            awaited[newest] = max(awaited[newest], max(logged) + 1)
        return awaited

    def add(self, key: str, envelope: Envelope | None) -> None:
        """Count a logged message."""
        self.counts[key] += 1
        if envelope is not None:
            self._follow(key, envelope)

    def save(
        self, part: Path, position: int, channels: dict[int, str], dropped: Mapping[str, int]
    ) -> None:
        """Save the state; all added messages are in the log, up to byte `position` of `part`. `dropped`: by
        key, since the start of the run."""
        senders = [(*sender, sequence) for sender, sequence in self._next.items()]
        saved = _Saved(
            self._run_id,
            part.name,
            position,
            channels,
            dict(self.counts),
            senders,
            dict(dropped),
        )
        data = msgspec.msgpack.encode(saved)
        with contextlib.suppress(OSError):  # a full disk: the older state stays
            os.pwrite(self._fd, _HEAD.pack(len(data), zlib.crc32(data)) + data, 0)

    def close(self) -> None:
        """Remove the file at the end of the run."""
        os.close(self._fd)
        self._path.unlink(missing_ok=True)

    def _logged_at_end(self, key: str) -> list[int]:
        """Sequence numbers in the log after the saved state. The log does not name their publishers: they
        are taken for those of the newest one of the key."""
        return [sequence for name, _, sequence in self._unplaced if name == key]

    def _missed_at_end(self, key: str) -> int:
        """Number of messages that the previous recorder dropped after it saved its state."""
        newest = next((n for (name, _), n in reversed(self._next.items()) if name == key), None)
        logged = self._logged_at_end(key)
        if newest is None or not logged:
            return 0
        return max(0, max(logged) + 1 - newest - len(logged))

    def _follow(self, key: str, envelope: Envelope) -> None:
        sender = (key, envelope.publisher)
        following = max(self._next.pop(sender, 0), envelope.sequence + 1)
        self._next[sender] = following
        if len(self._next) > _MOST_SENDERS:
            self._next.popitem(last=False)

    def _read(self, run_dir: Path) -> None:
        saved = _saved(run_dir / _FILE)
        if saved is None:  # the previous recorder died in its first second
            for path in parts(run_dir)[-1:]:
                self._read_end(path, 0, {})
            return
        if saved.run_id != self._run_id:
            return
        self.counts.update(saved.counts)
        self.dropped.update(saved.dropped)
        self._next.update({(key, sender): n for key, sender, n in saved.next_sequence})
        number = part_number(Path(saved.part))
        for path in parts(run_dir):
            if part_number(path) == number:
                self._read_end(path, saved.position, dict(saved.channels))
            elif part_number(path) > number:
                self._read_end(path, 0, {})
        for key in saved.dropped:
            self.dropped[key] += self._missed_at_end(key)

    def _read_end(self, path: Path, position: int, channels: dict[int, str]) -> None:
        with path.open("rb") as stream:
            size = stream.seek(0, 2)
            for found in whole_records(stream, size, position):
                if not isinstance(found, Found) or found.content is None:
                    continue
                content = found.content
                channels |= {id: channel.topic for id, channel in content.channels.items()}
                for message in content.messages:
                    key = channels.get(message.channel, "")
                    self.counts[key] += 1
                    self._unplaced.add((key, message.publish_ns, message.sequence))


def _saved(path: Path) -> _Saved | None:
    """The saved state; None if the file is missing or torn."""
    try:
        content = path.read_bytes()
        length, crc = _HEAD.unpack_from(content)
        data = content[_HEAD.size : _HEAD.size + length]
        if zlib.crc32(data) != crc:
            return None
        return msgspec.msgpack.decode(data, type=_Saved)
    except (OSError, struct.error, msgspec.MsgspecError):
        return None
