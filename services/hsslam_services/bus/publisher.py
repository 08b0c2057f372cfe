"""A publisher of one topic."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterable
from typing import Generic, Literal, TypeVar

import zenoh
import zenoh.ext

from hsslam_proto.codec import encode, encoding_of
from hsslam_proto.envelope import Envelope
from hsslam_proto.message import Message
from hsslam_proto.topics import Topic
from hsslam_services.bus.zenoh_session import open_shared_memory

M = TypeVar("M", bound=Message)
Report = Callable[[Literal["info", "warning", "error"], str], None]  # publishes an event
_HEARTBEAT_S = 0.25
_SHARED_BYTES = 2**20  # larger messages that may be dropped need shared memory from the first
_LARGE_BYTES = 2**17  # a larger message may fill the queue of a link


def priority(topic: Topic) -> zenoh.Priority:
    """The priority of a topic; each priority has a queue of its own in each link, so none blocks another.

    The order: poses and heartbeats, small messages that must arrive, frames, meshes.
    """
    if topic.size_limit_bytes <= _LARGE_BYTES:
        is_latest = topic.qos == "latest"
        return zenoh.Priority.REAL_TIME if is_latest else zenoh.Priority.INTERACTIVE_HIGH
    return zenoh.Priority.DATA if topic.qos == "latest" else zenoh.Priority.DATA_LOW


def has_subscribers(publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher) -> bool:
    """Whether a publisher has subscribers; always true if it keeps messages for late ones."""
    if not isinstance(publisher, zenoh.Publisher):
        return True
    status = publisher.matching_status  # the stubs of zenoh 1.10 call it a bool
    return bool(getattr(status, "matching", status))


class Publisher(Generic[M]):
    """Encodes and sends messages of one topic; created by `Bus.publisher`.

    `block`: wait for a congested link (at most 1 s) rather than drop; default: for qos "keep".
    `follows_all`: its messages never overtake earlier messages of its process, on any topic.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        topic: Topic[M],
        publisher_id: int,
        block: bool | None = None,
        follows_all: bool = False,
    ) -> None:
        self.topic = topic
        self.sent = 0
        self._id = publisher_id
        self._lock = threading.Lock()
        self._session, self._key = session, key
        self._queryable: zenoh.Queryable | None = None
        blocks = topic.qos == "keep" if block is None else block
        congestion = zenoh.CongestionControl.BLOCK if blocks else zenoh.CongestionControl.DROP
        encoding = zenoh.Encoding(encoding_of(topic))
        queue = zenoh.Priority.BACKGROUND if follows_all else priority(topic)
        if not blocks and topic.size_limit_bytes > _SHARED_BYTES:
            open_shared_memory(session)
        if topic.history == 0:
            self._publisher = session.declare_publisher(
                key, encoding=encoding, congestion_control=congestion, priority=queue
            )
            return
        self._publisher = zenoh.ext.declare_advanced_publisher(
            session,
            key,
            encoding=encoding,
            congestion_control=congestion,
            priority=queue,
            cache=zenoh.ext.CacheConfig(topic.history),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(
                heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S
            ),
            publisher_detection=True,
        )

    def put(self, message: M) -> None:
        """Send one message.

        Raises:
            ValueError: the message has another type, or exceeds the size limit of the topic.
        """
        self.put_payload(encode(self.topic, message), getattr(message, "stamp_ns", None))

    def put_payload(self, payload: bytes, stamp_ns: int | None = None) -> None:
        """Send an encoded payload, such as one from a log."""
        now = time.time_ns()
        stamp_ns = now if stamp_ns is None else stamp_ns
        with self._lock:  # events come from several threads
            envelope = Envelope(self._id, self.sent & 0xFFFFFFFF, stamp_ns, now)
            self.sent += 1
            self._publisher.put(payload, attachment=envelope.pack())

    def has_subscribers(self) -> bool:
        """Whether the topic has subscribers; always true for a topic with history."""
        return has_subscribers(self._publisher)

    def answer_with(self, state: Callable[[], Iterable[M]]) -> None:
        """Answer a `get` on the key of the topic with these messages; `state` runs in a thread of zenoh."""

        def reply(query: zenoh.Query) -> None:
            with query, contextlib.suppress(zenoh.ZError):  # the client is gone
                for message in state():
                    payload = encode(self.topic, message)
                    query.reply(
                        self._key, payload, encoding=zenoh.Encoding(encoding_of(self.topic))
                    )

        self._queryable = self._session.declare_queryable(self._key, reply)

    def close(self) -> None:
        """Undeclare the publisher."""
        if self._queryable is not None:
            self._queryable.undeclare()
        self._publisher.undeclare()
