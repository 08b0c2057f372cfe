"""The sending end of one topic."""

import threading
import time
from collections.abc import Callable
from typing import Generic, Literal, TypeVar

import zenoh
import zenoh.ext

from hsslam_proto.codec import encode, encoding_of
from hsslam_proto.envelope import Envelope
from hsslam_proto.messages import Message
from hsslam_proto.topics import Topic

M = TypeVar("M", bound=Message)
Report = Callable[[Literal["info", "warning", "error"], str], None]  # publishes an event
_HEARTBEAT_S = 0.25


class Publisher(Generic[M]):
    """Encodes and sends messages of one topic; `Bus.publisher` makes it.

    `block`: wait for a congested link (at most 1 s) rather than drop; default: for qos "keep".
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        topic: Topic[M],
        publisher_id: int,
        block: bool | None = None,
    ) -> None:
        self.topic = topic
        self.sent = 0
        self._id = publisher_id
        self._lock = threading.Lock()
        blocks = topic.qos == "keep" if block is None else block
        congestion = zenoh.CongestionControl.BLOCK if blocks else zenoh.CongestionControl.DROP
        encoding = zenoh.Encoding(encoding_of(topic))
        if topic.history == 0:
            self._publisher = session.declare_publisher(
                key, encoding=encoding, congestion_control=congestion
            )
            return
        self._publisher = zenoh.ext.declare_advanced_publisher(
            session,
            key,
            encoding=encoding,
            congestion_control=congestion,
            cache=zenoh.ext.CacheConfig(topic.history),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(
                heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S
            ),
            publisher_detection=True,
        )

    def put(self, message: M) -> None:
        """Send one message.

        Raises:
            ValueError: the message is of another type, or above the size limit of the topic.
        """
        self.put_payload(encode(self.topic, message), getattr(message, "stamp_ns", None))

    def put_payload(self, payload: bytes, stamp_ns: int | None = None) -> None:
        """Send a payload that is already encoded, such as one from a log."""
        now = time.time_ns()
        stamp_ns = now if stamp_ns is None else stamp_ns
        with self._lock:  # a process's events come from several threads
            envelope = Envelope(self._id, self.sent & 0xFFFFFFFF, stamp_ns, now)
            self.sent += 1
            self._publisher.put(payload, attachment=envelope.pack())

    def close(self) -> None:
        """Withdraw from the topic."""
        self._publisher.undeclare()
