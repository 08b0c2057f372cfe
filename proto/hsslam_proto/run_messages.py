"""Messages on the run itself: the end of its source, steps of lockstep, health, events, stop."""

# ruff: noqa: RUF012 - msgspec copies a default that is an empty list or map

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from hsslam_proto.message import (
    Counters,
    FrameIndex,
    Index,
    Level,
    Message,
    Name,
    StageTimes,
    StampNs,
    Text,
)


class SourceEnd(Message, frozen=True, kw_only=True):
    """The source has no more frames; `last_index`: of the last one sent (-1: none, or not told).

    `frame_count`: frames that were sent, and those that a slow recording left out (`skipped_frame_count`).
    """

    frame_count: Index
    bad_frame_count: Index = 0
    skipped_frame_count: Index = 0
    last_index: Annotated[int, Meta(ge=-1, le=2**63 - 1)] = -1
    reason: Text = ""


class Step(Message, frozen=True, kw_only=True):
    """Lockstep: frame `index` of a camera has been mapped, all work of the map on it is done, or the recorder
    has it in the log (or has refused it)."""

    stage: Literal["mapped", "done", "logged"]
    index: FrameIndex
    publisher: Index = 0


class TopicCounts(msgspec.Struct, frozen=True, kw_only=True):
    """Messages of one topic that came to a process (`received`), and those that it did not take: missed
    (`dropped`), unreadable or refused (`rejected`)."""

    dropped: Index = 0
    rejected: Index = 0
    received: Index = 0


class Health(Message, frozen=True, kw_only=True):
    """Heartbeat of one process: counters since its start and mean stage times.

    `pss_mb`: memory, shared pages divided among their users. `idle_ms`: since the main loop last came
    round. `topics`: what the process missed of the topics that it subscribes to, by topic.
    """

    process: Name
    pid: Index
    state: Name
    rss_bytes: Index
    pss_mb: Index = 0
    idle_ms: Index = 0
    topics: Annotated[dict[Name, TopicCounts], Meta(max_length=64)] = {}
    counters: Counters = {}
    stage_ms: StageTimes = {}


class Event(Message, frozen=True, kw_only=True):
    """Something that the operator should know, in one line."""

    process: Name
    level: Level
    text: Text
    stamp_ns: StampNs


class Hold(Message, frozen=True, kw_only=True):
    """The camera sends no frames while `paused`. An outside camera hears it during a reset alone: it should
    wait, too."""

    paused: bool


class Stop(Message, frozen=True, kw_only=True):
    """The run ends, and why; a note for the log. Processes end by SIGUSR1, stage by stage."""

    reason: Text
