"""Sends malformed messages and requests to a run, as an external client."""

import random
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import zenoh

from hsslam_bench.fuzz.malformed import Malformed, malformed, too_large
from hsslam_proto.codec import encoding_of
from hsslam_proto.requests import REFUSAL, REQUESTS, Request, rpc_prefix
from hsslam_proto.topics import TOPICS, Topic
from hsslam_services.bus.zenoh_session import open_client

# wait for a message of 256 MiB on a busy machine, rather than lose messages
PATIENT = {"transport/link/tx/queue/congestion_control/block/wait_before_close": 60_000_000}  # us
_AT_A_TIME = 8  # of each topic and request, between two pauses
_LARGE_BYTES = 2**20
_REPLY_S = 60.0
_NAMES = (
    "statu",
    "",
    "save/a",
    "*",
    "**",
    "..",
    "stop ",
    "a" * 200,
)  # of unknown requests

_READ = tuple(topic for topic in TOPICS if topic.logged)  # the recorder counts messages on these


def open_sending_session(endpoint: str) -> zenoh.Session:
    """A client session for `FuzzSender` that loses no message if the receiver is slow.

    Raises:
        UserError: no router answers at the endpoint.
    """
    return open_client(endpoint, settings=PATIENT)


@dataclass
class Sent:
    """Counts of messages and requests sent, and of answers."""

    messages: Counter[str] = field(default_factory=Counter)  # by topic
    requests: Counter[str] = field(default_factory=Counter)  # by name; "": unknown requests
    kinds: Counter[str] = field(default_factory=Counter)
    refused: int = 0
    not_refused: int = 0  # another answer, or none


class FuzzSender:
    """Sends messages on all topics that a process reads, and all requests of a robot, from one seed.

    `rate_hz`: the highest rate of each topic and request.
    """

    def __init__(self, session: zenoh.Session, robot: str, seed: int, rate_hz: float) -> None:
        self.sent = Sent()
        self._session = session
        self._robot = robot
        self._rng = random.Random(seed)
        self._rest_s = _AT_A_TIME / rate_hz

    def send(self, count: int, should_stop: Callable[[], bool] = lambda: False) -> Sent:
        """Send `count` of each, and one payload above each large size limit; returns the counts."""
        for topic in _READ:
            if topic.size_limit_bytes > _LARGE_BYTES:
                self._put(topic, too_large(topic))
        for size in _portions(count):
            begin_s = time.monotonic()
            if should_stop():
                break
            for topic in _READ:
                for _ in range(size):
                    self._put(topic, malformed(topic, self._rng))
            for request in REQUESTS:
                self._ask(request, size)
            self._ask_unknown()
            time.sleep(max(0.0, begin_s + self._rest_s - time.monotonic()))
        return self.sent

    def _put(self, topic: Topic, drawn: Malformed) -> None:
        self._session.put(
            topic.key(self._robot),
            drawn.payload,
            encoding=zenoh.Encoding(drawn.encoding),
            attachment=drawn.attachment,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        self.sent.messages[topic.name] += 1
        self.sent.kinds[drawn.kind] += 1

    def _ask(self, request: Request, count: int) -> None:
        asked = [malformed(request.asked, self._rng) for _ in range(count)]
        key = request.key(self._robot)
        self._account([self._get(key, drawn.payload, drawn.encoding) for drawn in asked])
        self.sent.requests[request.name] += count
        self.sent.kinds.update(drawn.kind for drawn in asked)

    def _ask_unknown(self) -> None:
        name = self._rng.choice(_NAMES)
        key = f"{rpc_prefix(self._robot)}{name}".rstrip("/ ")
        self._account([self._get(key, self._rng.randbytes(20), "zenoh/bytes")])
        self.sent.requests[""] += 1

    def _get(self, key: str, payload: bytes, encoding: str) -> "zenoh.Handler[zenoh.Reply]":
        return self._session.get(
            key, payload=payload, encoding=zenoh.Encoding(encoding), timeout=_REPLY_S
        )

    def _account(self, waiting: "list[zenoh.Handler[zenoh.Reply]]") -> None:
        for replies in waiting:
            answers = [reply.err and str(reply.err.encoding) for reply in replies]
            refused = answers == [encoding_of(REFUSAL)]
            self.sent.refused += refused
            self.sent.not_refused += not refused


def _portions(count: int) -> Iterator[int]:
    while count > 0:
        yield min(count, _AT_A_TIME)
        count -= _AT_A_TIME
