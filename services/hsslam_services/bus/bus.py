"""The connection of one process to the bus."""

import atexit
import os
import re
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple, TypeVar

from hsslam_node.errors import UserError
from hsslam_proto.codec import Rejected, decode
from hsslam_proto.message import Message
from hsslam_proto.request_messages import Refusal
from hsslam_proto.requests import Request
from hsslam_proto.topics import Topic
from hsslam_services.bus.kept_messages import get_state
from hsslam_services.bus.passed_on import PassedOnAnswers, pass_on
from hsslam_services.bus.publisher import Publisher
from hsslam_services.bus.requests import RequestQueue
from hsslam_services.bus.subscription import Subscription
from hsslam_services.bus.zenoh_session import (
    NO_SETTINGS,
    OVER_NETWORK,
    Settings,
    free_endpoint,
    open_client,
    open_router,
)
from hsslam_services.security.credentials import client_settings

__all__ = ["Bus", "LiveProcess", "free_endpoint", "open_router"]

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]*")


class LiveProcess(NamedTuple):
    """A process that holds its liveliness token; it may hang."""

    process: str
    pid: int


class Bus:
    """A client session with the router of a run; holds the liveliness token of this process.

    `security`: folder of the certificate for an endpoint `tls/HOST:PORT`. `settings`: further zenoh
    settings. Over `tcp/` and `tls/` a large message that may be dropped waits up to 1 s for a slow link.

    Never fork while a `Bus` is open: the child would hang. Use it as a context manager or call `close`.

    Raises:
        UserError: no router at `endpoint`, or an invalid name of a robot or process.
    """

    def __init__(
        self,
        endpoint: str,
        robot: str,
        process: str,
        security: str = "",
        settings: Settings = NO_SETTINGS,
    ) -> None:
        for field, name in (("robot", robot), ("process", process)):
            if not _NAME.fullmatch(name):
                raise UserError(f"{field} {name!r}: expected letters, digits, _ and - only")
        self.robot = robot
        self.process = process
        self._arrivals = threading.Condition()
        self._publishers: list[Publisher] = []
        self._subscriptions: list[Subscription] = []
        self._queues: list[RequestQueue] = []
        self._answers: list[PassedOnAnswers] = []
        self._closed = False
        of_link = OVER_NETWORK if endpoint.startswith(("tcp/", "tls/")) else NO_SETTINGS
        given = {**of_link, **client_settings(endpoint, security), **settings}
        self._session = open_client(endpoint, settings=given)
        atexit.register(self.close)  # an open session can keep the interpreter from ending
        token_key = f"{self._live_prefix}/{process}/{os.getpid()}"
        self._token = self._session.liveliness().declare_token(token_key)

    def publisher(
        self, topic: Topic[M], block: bool | None = None, follows_all: bool = False
    ) -> Publisher[M]:
        """A publisher of the topic; `block` overrides its qos (in lockstep, frames block).

        `follows_all`: its messages never overtake earlier messages of this process, on any topic.
        """
        key = topic.key(self.robot)
        publisher = Publisher(self._session, key, topic, secrets.randbits(32), block, follows_all)
        self._publishers.append(publisher)
        return publisher

    def subscribe(
        self,
        topic: Topic[M],
        depth: int = 1,
        history: bool | None = None,
        awaited: Mapping[int, int] | None = None,
    ) -> Subscription[M]:
        """A subscription that queues at most `depth` messages.

        `history`: fetch the messages in the publishers' caches first, and lost messages again; default:
        for topics with qos "keep". `awaited`: next sequence number by publisher, as an earlier subscription
        knew it; what came since counts as dropped.
        """
        wanted = topic.qos == "keep" if history is None else history
        subscription = Subscription(
            self._session,
            topic.key(self.robot),
            topic,
            depth,
            wanted and (topic.history > 0 or topic.keeps_state),
            self._arrivals,
            awaited or {},
        )
        self._subscriptions.append(subscription)
        return subscription

    def unsubscribe(self, subscription: Subscription[M]) -> None:
        """Close a subscription of this bus and forget it with its counters."""
        subscription.close()
        self._subscriptions.remove(subscription)

    def state(self, topic: Topic[M]) -> Iterator[M]:
        """The current state of a topic that keeps its state, as messages; waits for its publisher.

        Raises:
            IncompleteStateError: after what the publisher sent of it in time.
        """
        for sample in get_state(self._session, topic.key(self.robot)):
            message = decode(topic, sample.payload.to_bytes(), str(sample.encoding))
            if not isinstance(message, Rejected):
                yield message

    def requests(self) -> RequestQueue:
        """The queue of requests to this robot; one process answers them."""
        queue = RequestQueue(self._session, self.robot)
        self._queues.append(queue)
        return queue

    def answer(self, request: Request[Q, A], make: Callable[[Q], A | Refusal]) -> None:
        """Answer a request that the gateway passes on, in a thread of the bus."""
        self._answers.append(PassedOnAnswers(self._session, self.robot, request, make))

    def pass_on(self, request: Request[Q, A], message: Q) -> A | Refusal:
        """Pass a request on to the process that answers it; waits for the answer."""
        return pass_on(self._session, self.robot, request, message)

    @property
    def subscriptions(self) -> tuple[Subscription, ...]:
        """All subscriptions of this bus, with their counters."""
        return tuple(self._subscriptions)

    def wait(self, timeout_s: float) -> bool:
        """Wait until any subscription of this bus has a message; False after `timeout_s`."""
        deadline = time.monotonic() + timeout_s
        with self._arrivals:
            while not any(subscription.pending() for subscription in self._subscriptions):
                left_s = deadline - time.monotonic()
                if left_s <= 0:
                    return False
                self._arrivals.wait(left_s)
        return True

    def live_processes(self, timeout_s: float = 1.0) -> frozenset[LiveProcess]:
        """The processes of this robot that have a liveliness token at the router."""
        replies = self._session.liveliness().get(f"{self._live_prefix}/*/*", timeout=timeout_s)
        keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        return frozenset(_live_process(key) for key in keys)

    def live_robots(self, process: str, timeout_s: float = 1.0) -> list[str]:
        """The robots that have a process of this name with a liveliness token at the router."""
        tokens = f"hsslam/*/sys/live/{process}/*"
        replies = self._session.liveliness().get(tokens, timeout=timeout_s)
        return sorted({str(r.ok.key_expr).split("/")[1] for r in replies if r.ok is not None})

    def is_connected(self) -> bool:
        """Whether the router is connected now; the session reconnects by itself."""
        return not self._closed and bool(self._session.info.routers_zid())

    def close(self) -> None:
        """Undeclare all topics and close the session."""
        if self._closed:
            return
        self._closed = True
        atexit.unregister(self.close)
        for end in (*self._queues, *self._answers, *self._subscriptions, *self._publishers):
            end.close()
        self._token.undeclare()
        self._session.close()

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _live_prefix(self) -> str:
        return f"hsslam/{self.robot}/sys/live"


def _live_process(key: str) -> LiveProcess:
    process, pid = key.rsplit("/", 2)[1:]
    return LiveProcess(process, int(pid) if pid.isdecimal() else 0)
