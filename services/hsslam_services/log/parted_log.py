"""The log of the recorder, split into MCAP files (parts), each of which opens alone."""

from collections import Counter
from collections.abc import Callable, Mapping
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

_PARTS_KEPT = 4  # at least, if `keep_bytes` limits the log


@dataclass(frozen=True)
class LogSettings:
    """How a run is logged; each part gets `metadata` as the record `hsslam.run`.

    `keep_bytes` limits the log: the oldest parts are removed, and parts are at most a quarter of it.
    """

    color: Literal["jpeg", "png"] = "jpeg"
    part_bytes: int | None = None  # None: one file
    keep_bytes: int | None = None  # None: no limit
    metadata: Mapping[str, str] = field(default_factory=dict)


class PartedLog:
    """As `McapLog`, split into parts: when one is full, the next begins (run.1.mcap, ...).

    A part has its own schemas, channels, index and metadata. `counts`: over all parts written here.
    `removed`: names of the parts that were removed for `keep_bytes`. `on_next_part` gets the path of
    each part after the first, before a message is written to it.

    Raises:
        OSError: the first part cannot be written.
    """

    def __init__(
        self,
        run_dir: Path,
        robot: str,
        settings: LogSettings | None = None,
        on_next_part: Callable[[Path], None] = lambda path: None,
    ) -> None:
        self.settings = settings or LogSettings()
        self._run_dir = run_dir
        self._robot = robot
        self._on_next_part = on_next_part
        self._closed_counts: Counter[str] = Counter()
        self._lost_bytes = 0
        self._closed_refused = 0
        self._closed_sync_errors: dict[str, str] = {}  # by the name of the part
        self.removed: list[str] = []
        self._part = self._next_part()
        self._previous: McapLog | None = None  # a slow disk may still take it

    @property
    def path(self) -> Path:
        """The current part."""
        return self._part.path

    @property
    def counts(self) -> Counter[str]:
        """Number of messages by topic so far."""
        return self._closed_counts + self._part.counts

    @property
    def space_is_short(self) -> bool:
        """As in `McapLog`."""
        return self._part.space_is_short

    def write(
        self, topic: Topic, payload: bytes, log_ns: int, publish_ns: int, sequence: int
    ) -> bool:
        """Log one message of the bus, as `McapLog.write`; begins the next part if this one is full."""
        self._turn_if_full()
        return self._part.write(topic, payload, log_ns, publish_ns, sequence)

    def write_viz(self, message: VizMessage, log_ns: int, stamp_ns: int) -> None:
        """Log one message of the /viz layer in the current part."""
        self._part.write_viz(message, log_ns, stamp_ns)

    @property
    def refused(self) -> int:
        """Number of messages lost because the disk and the memory for waiting data are full."""
        return self._closed_refused + self._part.refused

    @property
    def sync_error(self) -> str:
        """As in `McapLog`, of all parts that are kept."""
        previous = self._previous.sync_error if self._previous else ""
        return next(iter(self._closed_sync_errors.values()), previous or self._part.sync_error)

    @property
    def place(self) -> tuple[Path, int, dict[int, str]]:
        """The end of the log after a `tick` that flushed: part, its bytes, keys of its channels by id."""
        return self._part.path, self._part.bytes_written, self._part.channel_keys

    def tick(self) -> bool:
        """Flush once a second, and then return whether all data is in the file; call this often."""
        if not self._part.tick():
            return False
        if self.settings.keep_bytes is not None:
            removed = remove_oldest(self._run_dir, self.settings.keep_bytes)
            self.removed += [path.name for path in removed]
            for path in removed:
                self._closed_sync_errors.pop(path.name, None)
        return self._part.pending_bytes == 0

    def close(self) -> int:
        """Finish the last part; returns the number of bytes lost to a full disk, normally 0."""
        self._lost_bytes += self._part.close()
        self._wait_for_previous()
        return self._lost_bytes

    def _wait_for_previous(self) -> None:
        if self._previous is not None:
            self._previous.wait_until_closed()
            if error := self._previous.sync_error:
                self._closed_sync_errors.setdefault(self._previous.path.name, error)

    def _turn_if_full(self) -> None:
        limit, keep = self.settings.part_bytes, self.settings.keep_bytes
        if keep is not None:
            limit = min(limit or keep, keep // _PARTS_KEPT)
        # a full disk has no room for the index: go on with this part
        if limit is None or self._part.bytes_written < limit or self._part.space_is_short:
            return
        following = self._next_part()
        self._wait_for_previous()
        self._lost_bytes += self._part.finish()
        self._previous = self._part
        self._closed_counts += self._part.counts
        self._closed_refused += self._part.refused
        self._part = following
        self._on_next_part(following.path)

    def _next_part(self) -> McapLog:
        path = next_part(self._run_dir)
        return McapLog(path, self._robot, metadata=self.settings.metadata)


def log_settings(run: RunInfo) -> LogSettings:
    """The log settings of this run."""
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
