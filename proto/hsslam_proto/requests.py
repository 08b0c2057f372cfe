"""Table of requests; the gateway, `hsslam-ctl`, the docs and tests iterate over it."""

from dataclasses import dataclass
from typing import Generic, TypeVar

from hsslam_proto import request_messages as r
from hsslam_proto.codec import Payload
from hsslam_proto.mesh import messages as mesh_messages
from hsslam_proto.message import Message

Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)


@dataclass(frozen=True)
class Request(Generic[Q, A]):
    """One row: a zenoh query on `hsslam/<robot>/rpc/<name>`, answered once.

    `takes_s`: shortest timeout that a client should use, s.
    `one_at_a_time`: another client is refused as busy while one is being answered.
    """

    name: str
    asked: Payload[Q]
    answered: Payload[A]
    purpose: str
    takes_s: float = 5.0
    one_at_a_time: bool = False

    @property
    def busy(self) -> r.Refusal:
        """Refusal of a second client, if `one_at_a_time`."""
        text = f"{self.name}: another client is being answered: expected one at a time"
        return r.Refusal(reason="busy", text=text)

    def key(self, robot: str) -> str:
        """The zenoh key of this request for one robot."""
        return f"{rpc_prefix(robot)}{self.name}"


def rpc_prefix(robot: str) -> str:
    """Prefix of the keys of all requests of a robot."""
    return f"hsslam/{robot}/rpc/"


_KIB, _MIB = 2**10, 2**20


def _row(
    name: str,
    asked: type[Q],
    answered: type[A],
    limit: int,
    purpose: str,
    takes_s: float = 5.0,
    asked_limit: int = 4 * _KIB,
    *,
    one_at_a_time: bool = False,
) -> Request[Q, A]:
    key = f"rpc/{name}"
    payloads = Payload(key, asked, asked_limit), Payload(key, answered, limit)
    return Request(name, *payloads, purpose, takes_s, one_at_a_time)


STATUS = _row("status", r.Ask, r.Status, 64 * _KIB, "state of the run")
MESH = _row("mesh", r.Ask, mesh_messages.Mesh, 256 * _MIB, "the newest mesh", 15.0)
TRAJECTORY = _row("trajectory", r.Ask, r.TrajectoryRows, 256 * _MIB, "all refined poses", 60.0)
QUERY = _row(
    *("query", r.QueryMap, r.PointAnswers, 4 * _MIB),
    *("distance, gradient, certainty at points in the map", 15.0, 2 * _MIB),
)
LOCATE = _row(
    *("locate", r.Locate, r.Located, 8 * _KIB, "relocalise near a pose", 15.0), one_at_a_time=True
)
SAVE = _row("save", r.SaveMap, r.SavedMap, 8 * _KIB, "save the map under a name", 400.0)
PAUSE = _row("pause", r.Ask, r.Done, 8 * _KIB, "pause the camera")
RESUME = _row("resume", r.Ask, r.Done, 8 * _KIB, "resume the camera")
SET_MODE = _row("set-mode", r.SetMode, r.Done, 8 * _KIB, "mapping, or localise-only: the map stays")
RESET = _row("reset", r.Ask, r.Done, 8 * _KIB, "discard the map and start a new one", 600.0)
STOP = _row("stop", r.Ask, r.Done, 8 * _KIB, "end the run in order")

REQUESTS: tuple[Request, ...] = (
    STATUS,
    MESH,
    TRAJECTORY,
    QUERY,
    LOCATE,
    SAVE,
    PAUSE,
    RESUME,
    SET_MODE,
    RESET,
    STOP,
)
REFUSAL: Payload[r.Refusal] = Payload("rpc", r.Refusal, 16 * _KIB)
