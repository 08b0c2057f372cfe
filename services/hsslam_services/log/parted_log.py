"""The log that the recorder writes: one MCAP file after another, each of which opens alone."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import msgspec

from hsslam_node import __version__
from hsslam_proto.foxglove.visualisation import VizMessage
from hsslam_proto.topics import Topic
from hsslam_services.log.mcap_writer import McapLog
from hsslam_services.log.parts import next_part, remove_oldest
from hsslam_services.run.run_info import RunInfo

_PARTS_KEPT = 4  # at least, of a log with a limit of bytes


@dataclass(frozen=True)
class LogSettings:
    """How a run is logged; `metadata` goes into every part as the record `hsslam.run`.

    Of a log with `keep_bytes` the oldest parts are removed; its parts are at most a quarter of that.
    """

    color: Literal["jpeg", "png"] = "jpeg"
    part_bytes: int | None = None  # none: one file
    keep_bytes: int | None = None  # none: all
    metadata: Mapping[str, str] = field(default_factory=dict)


class PartedLog:
    """As `McapLog`, going on in the next part (run.1.mcap, ...) of the run folder when one is full.

    A part brings its own schemas, channels, index and metadata. `counts` is over all parts written
    here; `removed` are the parts that were too much to keep.

    Raises:
        OSError: the first part cannot be written.
    """

    def __init__(self, run_dir: Path, robot: str, settings: LogSettings | None = None) -> None:
        self.settings = settings or LogSettings()
        self._run_dir = run_dir
        self._robot = robot
        self._closed_counts: Counter[str] = Counter()
        self._lost_bytes = 0
        self._closed_refused = 0
        self.removed: list[str] = []
        self._part = self._next_part()

    @property
    def path(self) -> Path:
        """The part that is being written."""
        return self._part.path

    @property
    def counts(self) -> Counter[str]:
        """Messages of each topic so far."""
        return self._closed_counts + self._part.counts

    @property
    def space_is_short(self) -> bool:
        """As of `McapLog`."""
        return self._part.space_is_short

    def write(
        self, topic: Topic, payload: bytes, log_ns: int, publish_ns: int, sequence: int
    ) -> bool:
        """Log one message of the bus; a part that is full ends before it. As of `McapLog`."""
        self._turn_if_full()
        return self._part.write(topic, payload, log_ns, publish_ns, sequence)

    def write_viz(self, message: VizMessage, log_ns: int, stamp_ns: int) -> None:
        """Log one message of the /viz layer, in the part of what it shows."""
        self._part.write_viz(message, log_ns, stamp_ns)

    @property
    def refused(self) -> int:
        """Messages that found no room on a full disk, nor in memory."""
        return self._closed_refused + self._part.refused

    @property
    def sync_error(self) -> str:
        """As of `McapLog`."""
        return self._part.sync_error

    @property
    def place(self) -> tuple[Path, int, dict[int, str]]:
        """Where the log ends after a `tick` that flushed: part, bytes, keys of the channels by id."""
        return self._part.path, self._part.bytes_written, self._part.channel_keys

    def tick(self) -> bool:
        """Call it often; once a second it flushes everything, and says whether all is in the file."""
        if not self._part.tick():
            return False
        if self.settings.keep_bytes is not None:
            removed = remove_oldest(self._run_dir, self.settings.keep_bytes)
            self.removed += [path.name for path in removed]
        return self._part.pending_bytes == 0

    def close(self) -> int:
        """Finish the last part; returns the bytes that a full disk refused (0 in health)."""
        return self._lost_bytes + self._part.close()

    def _turn_if_full(self) -> None:
        limit, keep = self.settings.part_bytes, self.settings.keep_bytes
        if keep is not None:
            limit = min(limit or keep, keep // _PARTS_KEPT)
        # on a full disk there is no room for an index: stay, and let the part catch up
        if limit is None or self._part.bytes_written < limit or self._part.space_is_short:
            return
        following = self._next_part()
        self._lost_bytes += self._part.close()
        self._closed_counts += self._part.counts
        self._closed_refused += self._part.refused
        self._part = following

    def _next_part(self) -> McapLog:
        path = next_part(self._run_dir)
        return McapLog(path, self._robot, metadata=self.settings.metadata)


def log_settings(run: RunInfo) -> LogSettings:
    """How this run wants its log."""
    options = run.options
    metadata = {
        "run_id": run.run_id,
        "robot": run.robot,
        "started_ns": str(run.started_ns),
        "version": __version__,
        "options": msgspec.json.encode(options).decode(),
    }
    part_bytes = options.log_part_mb * 2**20 or None
    keep_bytes = round(options.log_keep * 1e9) or None
    return LogSettings(options.log_color, part_bytes, keep_bytes, metadata)
