"""Messages about the run itself: end of the source, steps of lockstep, health, events, stop."""

# ruff: noqa: RUF012 - msgspec copies a default that is an empty list or map

import time
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

_TEXT_BYTES = 4096  # of an event: at most as many characters, and small in a message


class SourceEnd(Message, frozen=True, kw_only=True):
    """The source has no more frames; `last_index`: index of the last frame sent (-1: none, or unknown).

    `frame_count`: number of frames sent, plus the `skipped_frame_count` late frames that the camera skipped.
    """

    frame_count: Index
    bad_frame_count: Index = 0
    skipped_frame_count: Index = 0
    last_index: Annotated[int, Meta(ge=-1, le=2**63 - 1)] = -1
    reason: Text = ""


class Step(Message, frozen=True, kw_only=True):
    """Lockstep: the mapper has mapped frame `index`, all work of the map on it is done, or the recorder has
    logged (or refused) it."""

    stage: Literal["mapped", "done", "logged"]
    index: FrameIndex
    publisher: Index = 0


class TopicCounts(msgspec.Struct, frozen=True, kw_only=True):
    """Messages of one topic that a process received, missed (`dropped`), and could not read or refused
    (`rejected`)."""

    dropped: Index = 0
    rejected: Index = 0
    received: Index = 0


class Health(Message, frozen=True, kw_only=True):
    """Heartbeat of one process: counters since its start and mean stage times.

    `pss_mb`: memory, shared pages divided among their users. `idle_ms`: time since the last turn of the main
    loop. `topics`: counts of the messages of each topic that the process subscribes to.
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
    """A line for the operator."""

    process: Name
    level: Level
    text: Text
    stamp_ns: StampNs

    @staticmethod
    def now(process: str, level: Level, text: str) -> "Event":
        """An event with the time of now; cuts a text of more than 4096 bytes in UTF-8."""
        text = text.encode(errors="replace")[:_TEXT_BYTES].decode(errors="ignore")
        return Event(process=process, level=level, text=text, stamp_ns=time.time_ns())


class Hold(Message, frozen=True, kw_only=True):
    """The camera sends no frames while `paused`. An outside camera gets this message only during a reset: it
    should wait, too."""

    paused: bool


class Stop(Message, frozen=True, kw_only=True):
    """The run ends for this reason; a note for the log. The supervisor ends processes by SIGRTMIN, stage by
    stage."""

    reason: Text
