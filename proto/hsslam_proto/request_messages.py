"""What is asked and answered under `rpc/`, as msgspec structs; encoded like the messages of topics."""

from typing import Annotated, Literal

from msgspec import Meta

from hsslam_proto.messages import Counters, Index, Message, Name, Real, Text

Mode = Literal["mapping", "localise-only"]
MapName = Annotated[str, Meta(pattern="^[A-Za-z0-9_-]{1,64}$")]


class RequestMessage(Message, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a client asks: a field that is not known is refused, so that nothing is done other than meant."""


class Ask(RequestMessage, frozen=True, kw_only=True):
    """A request that needs no arguments; no payload at all means the same."""


class SaveMap(RequestMessage, frozen=True, kw_only=True):
    """Keep the map as it is now under a name: letters, digits, _ and -, 64 at most."""

    name: MapName
    replace: bool = False


class SetMode(RequestMessage, frozen=True, kw_only=True):
    """Go on mapping, or only localise: the map then stays as it is."""

    mode: Mode


class Status(Message, frozen=True, kw_only=True):
    """How the run goes; counts since its start, rate and latency of the last seconds.

    `map_epoch`: how often the map was thrown away; `keyframes` and `map_version` are those of the new one.
    `load_level`: how much of the work gives way to the latency, 0: nothing.
    """

    run_id: Name
    state: Literal["starting", "running", "paused", "stopping"]
    source: Text
    preset: Name
    pace: Name
    seconds: Real
    frames_sent: Index
    frames_tracked: Index
    frames_lost: Index
    frames_dropped: Index
    fps: Real
    latency_ms: Real
    tracking: Literal["none", "initial", "tracked", "lost"]
    quality: Real
    keyframes: Index
    map_version: Index
    ba_rounds: Index
    memory_mb: Index
    requests: Index
    requests_refused: Index
    messages_rejected: Index = 0
    processes: dict[Name, Name]
    restarts: Counters
    mode: Mode = "mapping"
    map_epoch: Index = 0
    load_level: Index = 0


class TrajectoryRows(Message, frozen=True, kw_only=True):
    """Poses so far as refined, lost frames left out: `stamps_ns` [N] int64 of the source, `poses`
    [N, 7] float64 x y z (m) and unit quaternion x y z w, camera to world; both little endian.

    After a reset: those of the new map, whose number is `map_epoch`."""

    count: Index
    stamps_ns: memoryview
    poses: memoryview
    map_epoch: Index = 0

    def __post_init__(self) -> None:
        for name, width in (("stamps_ns", 8), ("poses", 56)):
            size = memoryview(getattr(self, name)).nbytes
            if size != width * self.count:
                raise ValueError(f"{name} has {size} bytes: expected {width * self.count}")


class SavedMap(Message, frozen=True, kw_only=True):
    """The map was saved on the service's machine."""

    name: MapName
    path: Text
    nbytes: Index
    keyframes: Index


class Done(Message, frozen=True, kw_only=True):
    """It was done, or was so already; `text` says which."""

    text: Text


class Refusal(Message, frozen=True, kw_only=True):
    """Why a request was not done. `unknown` to `malformed`: the request is wrong; `busy`, `not_now`,
    `failed`: the service cannot do it."""

    reason: Literal[
        "unknown", "encoding", "schema", "version", "size", "malformed", "busy", "not_now", "failed"
    ]
    text: Text
