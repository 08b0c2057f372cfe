"""Reads a run's log with the public MCAP reader."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import msgspec
from mcap.exceptions import McapError
from mcap.reader import make_reader

_POSE, _HEALTH = "out/pose", "sys/health"
_MAPPER, _ITERATIONS = "mapper", "iterations"


class LoggedPose(NamedTuple):
    """One pose of the log; times are wall clock."""

    index: int
    publish_ns: int
    latency_ms: float  # sensor stamp to published pose
    status: str


@dataclass(frozen=True)
class LogContent:
    """The content of run.mcap that figures need."""

    counts: Mapping[str, int]  # messages by topic, as "out/pose"
    poses: Sequence[LoggedPose] = ()  # by frame index
    mapped: Sequence[tuple[int, int]] = ()  # wall clock ns, mapping iterations until then
    error: str = ""

    def first_ns(self, status: str | None = None) -> int | None:
        """Publishing time of the first pose of this status (None: of any status)."""
        found = (p.publish_ns for p in self.poses if status is None or p.status == status)
        return next(found, None)

    @property
    def tracking_ns(self) -> tuple[int, int] | None:
        """Publishing times of the first tracked pose and of the last pose; None: no such interval."""
        begin = self.first_ns("tracked")
        end = max((pose.publish_ns for pose in self.poses), default=0)
        return None if begin is None or end <= begin else (begin, end)


def read_log(path: Path) -> LogContent:
    """Read a log; `error` describes a log that is not readable."""
    counts: Counter[str] = Counter()
    poses: list[LoggedPose] = []
    mapped: list[tuple[int, int]] = []
    try:
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            for _, channel, message in reader.iter_messages(log_time_order=False):
                topic = "/".join(channel.topic.split("/")[-2:])
                counts[topic] += 1
                if topic == _POSE:
                    poses.append(_pose(msgspec.msgpack.decode(message.data)))
                elif topic == _HEALTH:
                    health = msgspec.msgpack.decode(message.data)
                    if health["process"] == _MAPPER and _ITERATIONS in health["counters"]:
                        mapped.append((message.publish_time, health["counters"][_ITERATIONS]))
    except (OSError, McapError) as error:
        return LogContent({}, error=f"{path.name}: {error}")
    return LogContent(dict(counts), sorted(poses), sorted(mapped))


def _pose(fields: Mapping) -> LoggedPose:
    latency_ms = round((fields["publish_ns"] - fields["stamp_ns"]) / 1e6, 2)
    return LoggedPose(fields["index"], fields["publish_ns"], latency_ms, fields["status"])
