"""The receiving end of one topic: a ring where the newest wins, filled by one reader thread."""

import threading
import time
from collections import Counter, deque
from dataclasses import dataclass
from typing import Generic, TypeVar

import zenoh
import zenoh.ext

from hsslam_node.proto.codec import Rejected, check, decode
from hsslam_node.proto.envelope import Envelope
from hsslam_node.proto.messages import Message
from hsslam_node.proto.topics import Topic

M = TypeVar("M", bound=Message)
_KEPT_REJECTIONS = 16


@dataclass(frozen=True)
class Received:
    """A payload as it came, not yet decoded; `envelope` is None for publishers without one."""

    payload: bytes
    encoding: str
    envelope: Envelope | None
    arrival_ns: int


class Subscription(Generic[M]):
    """Messages of one topic, oldest kept first; `Bus.subscribe` makes it.

    At most `depth` messages wait; one more pushes the oldest out. Counters: `received`, `dropped`
    (pushed out, or missing in a publisher's sequence) and `rejected` (could not be read).
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        topic: Topic[M],
        depth: int,
        history: bool,
        arrivals: threading.Condition,
    ) -> None:
        self.topic = topic
        self.received = 0
        self.dropped = 0
        self.rejected = 0
        self._rejections: deque[Rejected] = deque(maxlen=_KEPT_REJECTIONS)
        self._next_sequence: Counter[int] = Counter()
        self._arrivals = arrivals
        self._waiting: deque[Received] = deque()
        self._depth = depth
        self._subscriber = _declare(session, key, zenoh.handlers.RingChannel(depth), history)
        # recv() on the subscriber itself would make undeclare() fail while the thread waits in it
        self._thread = threading.Thread(
            target=self._read, args=(self._subscriber.handler,), name=topic.name, daemon=True
        )
        self._thread.start()

    def poll(self) -> M | None:
        """The oldest waiting message, or None at once; what cannot be decoded is counted."""
        while (received := self.poll_raw()) is not None:
            message = self.decode(received)
            if message is not None:
                return message
        return None

    def wait(self, timeout_s: float) -> M | None:
        """The oldest waiting message; waits up to `timeout_s` for one."""
        arrived = self.wait_received(timeout_s)
        return None if arrived is None else arrived[0]

    def wait_received(self, timeout_s: float) -> tuple[M, Received] | None:
        """As `wait`, with how and when the message came."""
        deadline = time.monotonic() + timeout_s
        while True:
            while (received := self.poll_raw()) is not None:
                message = self.decode(received)
                if message is not None:
                    return message, received
            with self._arrivals:
                left_s = deadline - time.monotonic()
                if left_s <= 0:
                    return None
                if not self._waiting:
                    self._arrivals.wait(left_s)

    def drain(self) -> list[M]:
        """All waiting messages, oldest first."""
        messages = []
        while (message := self.poll()) is not None:
            messages.append(message)
        return messages

    def poll_raw(self) -> Received | None:
        """The oldest waiting payload, not decoded, or None at once."""
        try:
            return self._waiting.popleft()
        except IndexError:
            return None

    def decode(self, received: Received) -> M | None:
        """The message of a payload; None, counted, if it cannot be read."""
        message = decode(self.topic, received.payload, received.encoding)
        if isinstance(message, Rejected):
            self._reject(message)
            return None
        return message

    def pending(self) -> int:
        """Messages that wait now."""
        return len(self._waiting)

    def take_rejections(self) -> list[Rejected]:
        """Why payloads were rejected since the last call (at most the last 16)."""
        taken = []
        while self._rejections:
            taken.append(self._rejections.popleft())
        return taken

    def close(self) -> None:
        """Withdraw from the topic; what waits stays readable."""
        self._subscriber.undeclare()
        self._thread.join(timeout=2.0)

    def _read(self, handler: zenoh.Handler[zenoh.Sample]) -> None:
        while True:
            try:
                sample = handler.recv()
            except zenoh.ZError:  # the subscriber is undeclared or the session closed
                return
            self._take(sample)
            del sample  # hands its shared memory back before the next wait

    def _take(self, sample: zenoh.Sample) -> None:
        self.received += 1
        encoding = str(sample.encoding)
        rejected = check(self.topic, len(sample.payload), encoding)
        if rejected is not None:
            self._reject(rejected)
            return
        attachment = sample.attachment
        envelope = Envelope.unpack(None if attachment is None else attachment.to_bytes())
        if envelope is not None:
            self._count_gap(envelope)
        received = Received(sample.payload.to_bytes(), encoding, envelope, time.time_ns())
        with self._arrivals:
            if len(self._waiting) >= self._depth:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(received)
            self._arrivals.notify_all()

    def _count_gap(self, envelope: Envelope) -> None:
        expected = self._next_sequence.get(envelope.publisher)
        if expected is not None and envelope.sequence > expected:
            self.dropped += envelope.sequence - expected
        self._next_sequence[envelope.publisher] = max(expected or 0, envelope.sequence + 1)

    def _reject(self, rejected: Rejected) -> None:
        self.rejected += 1
        self._rejections.append(rejected)


def _declare(
    session: zenoh.Session,
    key: str,
    ring: "zenoh.handlers.RingChannel[zenoh.Sample]",
    history: bool,
) -> "zenoh.Subscriber | zenoh.ext.AdvancedSubscriber":
    if not history:
        return session.declare_subscriber(key, ring)
    return zenoh.ext.declare_advanced_subscriber(
        session,
        key,
        ring,
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
        recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
    )
