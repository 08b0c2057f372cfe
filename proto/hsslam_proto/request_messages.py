"""Requests and answers under `rpc/`, as msgspec structs; encoded like the messages of topics."""

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
    """A request of a client. A request with an unknown field is refused, so the service never does only a
    part of it."""


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
    """Distance, gradient and certainty at points: `points` [N, 3] float32 x y z (m, world of the map), little
    endian, at most 100000 points.

    A client divides more points among several requests."""

    points: memoryview

    def __post_init__(self) -> None:
        size = memoryview(self.points).nbytes
        if size % POINT_BYTES or size > POINT_BYTES * MOST_POINTS:
            raise ValueError(
                f"points has {size} bytes: expected {POINT_BYTES} a point, of at most {MOST_POINTS}"
            )


class Locate(RequestMessage, frozen=True, kw_only=True):
    """Relocalise the camera near a pose in the frame of the map's floor, whose z is up: `x` and `y` in m,
    `yaw_deg` 0 along x and positive to the left.

    The pose is that of `base_link` if `--base-T-camera` is set, else that of the camera. While one client is
    being answered, another is refused as `busy`."""

    x: Coordinate
    y: Coordinate
    yaw_deg: Degrees


class Status(Message, frozen=True, kw_only=True):
    """State of the run; counts since its start, rate and latency of the last seconds.

    `tracking` and `quality` are those of the last pose; `none` and 0 before the first, and if no further one
    came for 5 s, or for twice the time between the last two poses if that is longer. `map_epoch`: number of
    resets so far; `keyframes` and `map_version` are those of the current map. `load_level`: how much work the
    service leaves out to keep the latency low, 0: none.
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
    """Refined poses so far, without lost frames: `stamps_ns` [N] int64 of the source, `poses`
    [N, 7] float64 x y z (m) and unit quaternion x y z w, camera to world; both little endian.

    After a reset: the poses in the new map, whose number is `map_epoch`."""

    count: Index
    stamps_ns: memoryview
    poses: memoryview
    map_epoch: Index = 0

    def __post_init__(self) -> None:
        for name, width in (("stamps_ns", 8), ("poses", 56)):
            expect_bytes(self, name, width * self.count)


class SavedMap(Message, frozen=True, kw_only=True):
    """The service has saved the map on its machine."""

    name: MapName
    path: Text
    nbytes: Index
    keyframes: Index


class PointAnswers(Message, frozen=True, kw_only=True):
    """Answers for each point, in the order of the request: `distance_m` [N] float32 to the nearest surface
    that keyframes saw, negative behind it, nan if unknown; `gradient` [N, 3] float32 of the distance, of unit
    length, or 0 if there is none; `known` [N] uint8, 1 if a keyframe saw the place, as free or as surface;
    `certainty` [N] float32, 0 to 1, by the number and distance of the keyframes that saw the place; all
    little endian.

    `map_version`: version of the map that answered."""

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
    """The camera is found: frame `index` was tracked at this pose, in the frame of the request.

    `up_by`: source of the direction up in that frame."""

    index: FrameIndex
    x: Real
    y: Real
    yaw_deg: Real
    up_by: Name
    map_epoch: Index = 0


class Done(Message, frozen=True, kw_only=True):
    """The request is done, or had no effect because it was done before; `text` names which."""

    text: Text


class Refusal(Message, frozen=True, kw_only=True):
    """Why the service refuses a request. `unknown` to `malformed`: the request is wrong; `busy`, `not_now`,
    `failed`: the service cannot do it; `unfinished`: it takes longer, ask again."""

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
