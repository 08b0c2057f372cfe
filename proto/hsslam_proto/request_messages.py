"""What is asked and answered under `rpc/`, as msgspec structs; encoded like the messages of topics."""

from typing import Annotated, Literal

from msgspec import Meta

from hsslam_proto.message import (
    Counters,
    FrameIndex,
    Index,
    Message,
    Name,
    Real,
    Text,
    expect_bytes,
)

Mode = Literal["mapping", "localise-only"]
MOST_POINTS, POINT_BYTES = 100_000, 12  # of a query
Coordinate = Annotated[float, Meta(ge=-1e6, le=1e6)]
Degrees = Annotated[float, Meta(ge=-1e4, le=1e4)]
MapName = Annotated[
    str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}(?!\n)$")
]  # $ stands before a last \n, too


class RequestMessage(Message, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a client asks: a field that is not known is refused, so that nothing else than asked is done."""


class Ask(RequestMessage, frozen=True, kw_only=True):
    """A request that needs no arguments; no payload at all means the same."""


class SaveMap(RequestMessage, frozen=True, kw_only=True):
    """Keep the map as it is now under a name: letters, digits, _ and -, 64 at most."""

    name: MapName
    replace: bool = False


class SetMode(RequestMessage, frozen=True, kw_only=True):
    """Go on mapping, or only localise: the map then stays as it is."""

    mode: Mode


class QueryMap(RequestMessage, frozen=True, kw_only=True):
    """What the map says of places: `points` [N, 3] float32 x y z (m, world of the map), little endian, one
    after the other, 100000 points at most.

    A client divides more points among several requests."""

    points: memoryview

    def __post_init__(self) -> None:
        size = memoryview(self.points).nbytes
        if size % POINT_BYTES or size > POINT_BYTES * MOST_POINTS:
            raise ValueError(
                f"points has {size} bytes: expected {POINT_BYTES} a point, of at most {MOST_POINTS}"
            )


class Locate(RequestMessage, frozen=True, kw_only=True):
    """Look for the camera near a pose in the frame of the map's floor, whose z is up: `x` and `y` in m,
    `yaw_deg` 0 along x and positive to the left.

    It is that of `base_link` if the service knows the camera on it (`--base-T-camera`), else that of the
    camera."""

    x: Coordinate
    y: Coordinate
    yaw_deg: Degrees


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
            expect_bytes(self, name, width * self.count)


class SavedMap(Message, frozen=True, kw_only=True):
    """The map was saved on the service's machine."""

    name: MapName
    path: Text
    nbytes: Index
    keyframes: Index


class PointAnswers(Message, frozen=True, kw_only=True):
    """What the map says of each point asked, in their order: `distance_m` [N] float32 to the nearest
    surface, negative behind it, nan where not known; `gradient` [N, 3] float32 of the distance, of unit
    length, or 0 where it has none; `known` [N] uint8, 1 if a keyframe saw the place, as free or as surface;
    `certainty` [N] float32, 0 to 1, by how many keyframes saw the place and from how near; all little endian.

    `map_version`: of the map that was asked."""

    count: Index
    distance_m: memoryview
    gradient: memoryview
    known: memoryview
    certainty: memoryview
    map_version: Index
    map_epoch: Index = 0

    def __post_init__(self) -> None:
        for name, width in (("distance_m", 4), ("gradient", 12), ("known", 1), ("certainty", 4)):
            expect_bytes(self, name, width * self.count)


class Located(Message, frozen=True, kw_only=True):
    """The camera is there: frame `index` was tracked at this pose, in the frame of the question.

    `up_by`: what tells which way is up in that frame."""

    index: FrameIndex
    x: Real
    y: Real
    yaw_deg: Real
    up_by: Name
    map_epoch: Index = 0


class Done(Message, frozen=True, kw_only=True):
    """It was done, or was so already; `text` says which."""

    text: Text


class Refusal(Message, frozen=True, kw_only=True):
    """Why a request was not done. `unknown` to `malformed`: the request is wrong; `busy`, `not_now`,
    `failed`: the service cannot do it; `unfinished`: a part is done, ask again for the rest."""

    reason: Literal[
        "unknown",
        "encoding",
        "schema",
        "version",
        "size",
        "malformed",
        "busy",
        "not_now",
        "failed",
        "unfinished",
    ]
    text: Text
