"""A subscriber of one topic: a reader thread fills a queue that drops the oldest message if it is full."""

import contextlib
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import zenoh
import zenoh.ext

from hsslam_proto.codec import Rejected, check, decode
from hsslam_proto.envelope import Envelope
from hsslam_proto.message import Message
from hsslam_proto.topics import Topic
from hsslam_services.bus.kept_messages import IncompleteStateError, get_history, get_state

M = TypeVar("M", bound=Message)
_KEPT_REJECTIONS = 16
_LARGE_BYTES = 2**23
_RING, _LARGE_RING = 1024, 64  # messages between two reads; for topics of large messages
_STATE_TRIES = 3  # if a busy publisher does not send all of its state
_PUBLISHERS = 64  # whose sequence numbers are checked


@dataclass(frozen=True)
class Received(Generic[M]):
    """A message and its payload as received; `envelope` is None if the publisher sends none.

    `arrival_ns`: by the wall clock. `missed`: number of messages dropped between the one read before and this
    one.
    """

    message: M
    payload: bytes
    envelope: Envelope | None
    arrival_ns: int
    arrival_monotonic_ns: int
    missed: int = 0


class Subscription(Generic[M]):
    """Messages of one topic, oldest first; created by `Bus.subscribe`.

    At most `depth` messages wait; a further message drops the oldest. Malformed messages never wait, so
    they drop none. Counters: `received`, `missing` (in a publisher's sequence), `dropped` (from the queue or
    by the reader, or missing) and `rejected` (malformed, or refused by the reader).
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        topic: Topic[M],
        depth: int,
        history: bool,
        arrivals: threading.Condition,
        awaited: Mapping[int, int],
    ) -> None:
        self.topic = topic
        self._session, self._key = session, key
        self.received = 0
        self.dropped = 0
        self.missing = 0
        self._unreadable = 0
        self._refused = 0
        self._rejections: deque[Rejected] = deque(maxlen=_KEPT_REJECTIONS)
        self._next_sequence: OrderedDict[int, int] = OrderedDict(awaited)
        self._history_until: dict[int, int] = {}  # sequence by publisher
        self._arrivals = arrivals
        self._waiting: deque[Received[M]] = deque()
        self._depth = depth
        ring = max(depth, _RING if topic.size_limit_bytes < _LARGE_BYTES else _LARGE_RING)
        self._subscriber = _declare(session, key, zenoh.handlers.RingChannel(ring), history)
        # recv() on the subscriber itself would make undeclare() fail while the thread waits in it
        self._thread = threading.Thread(
            target=self._read,
            args=(self._subscriber.handler, history and topic.history > 0),
            name=topic.name,
            daemon=True,
        )
        self._thread.start()
        if history and topic.keeps_state:
            self.ask_state()

    def ask_state(self) -> None:
        """Fetch the current state of the topic in another thread, and queue its messages."""
        threading.Thread(target=self._read_state, name=self.topic.name, daemon=True).start()

    def poll(self) -> M | None:
        """The oldest waiting message, or None; does not wait."""
        received = self.poll_received()
        return None if received is None else received.message

    def poll_received(self) -> Received[M] | None:
        """As `poll`, with payload, envelope and time of arrival."""
        with self._arrivals:
            return self._waiting.popleft() if self._waiting else None

    def wait(self, timeout_s: float) -> M | None:
        """The oldest waiting message; waits up to `timeout_s` for one."""
        received = self.wait_received(timeout_s)
        return None if received is None else received.message

    def wait_received(self, timeout_s: float) -> Received[M] | None:
        """As `wait`, with payload, envelope and time of arrival."""
        deadline = time.monotonic() + timeout_s
        while True:
            received = self.poll_received()
            if received is not None:
                return received
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

    def pending(self) -> int:
        """Number of waiting messages."""
        return len(self._waiting)

    @property
    def rejected(self) -> int:
        """Number of messages that were malformed or refused."""
        return self._unreadable + self._refused

    def refuse(self, text: str) -> None:
        """Count a message as rejected after reading it; only the thread that reads messages calls this."""
        self._refused += 1
        self._rejections.append(Rejected(self.topic.name, "sequence", f"{self.topic.name}: {text}"))

    def drop(self) -> None:
        """Count a message as dropped after reading it: unusable, or older than one that waits."""
        with self._arrivals:
            self.dropped += 1

    def take_rejections(self) -> list[Rejected]:
        """The reasons of rejections since the last call, at most the last 16."""
        taken = []
        while self._rejections:
            taken.append(self._rejections.popleft())
        return taken

    def close(self) -> None:
        """Undeclare the subscriber; waiting messages stay readable."""
        with contextlib.suppress(zenoh.ZError):  # undeclared already
            self._subscriber.undeclare()
        self._thread.join(timeout=2.0)

    def _read(self, handler: zenoh.Handler[zenoh.Sample], history: bool) -> None:
        """Take the publishers' history, then the messages since the declaration that it does not hold."""
        if history:
            self._read_history()
        sample: zenoh.Sample | None
        while True:
            try:
                sample = handler.recv()
                # empty the ring before the next recv(): it releases the GIL and, in a busy process, gets it
                # back 5 ms later, when the ring may have overflowed
                while sample is not None:
                    self._take(sample)
                    del sample  # frees its shared memory before the next wait
                    sample = handler.try_recv()
            except zenoh.ZError:  # the subscriber is undeclared or the session closed
                return

    def _read_history(self) -> None:
        with contextlib.suppress(zenoh.ZError):  # the session is closed
            for sample in get_history(self._session, self._key):
                self._take(sample)
        self._history_until = dict(self._next_sequence)

    def _read_state(self) -> None:
        for _ in range(_STATE_TRIES):
            try:
                for sample in get_state(self._session, self._key):
                    self._take(sample)
            except IncompleteStateError:  # its publisher is busy, or has died
                continue
            except zenoh.ZError:  # the session is closed
                return
            return

    def _take(self, sample: zenoh.Sample) -> None:
        received = self._readable(sample)
        if isinstance(received, Received) and self._is_from_history(received.envelope):
            return
        with self._arrivals:
            self.received += 1
            if isinstance(received, Rejected):
                self._unreadable += 1
                self._rejections.append(received)
                return
            gap = 0 if received.envelope is None else self._gap_before(received.envelope)
            self.dropped += gap
            self.missing += gap
            self._waiting.append(replace(received, missed=gap) if gap else received)
            if len(self._waiting) > self._depth:
                missed = self._waiting.popleft().missed + 1
                self._waiting[0] = replace(
                    self._waiting[0], missed=self._waiting[0].missed + missed
                )
                self.dropped += 1
            self._arrivals.notify_all()

    def _readable(self, sample: zenoh.Sample) -> Received[M] | Rejected:
        encoding = str(sample.encoding)
        rejected = check(self.topic, len(sample.payload), encoding)  # before anything is copied
        if rejected is not None:
            return rejected
        attachment = sample.attachment
        try:
            envelope = None if attachment is None else Envelope.unpack(attachment.to_bytes())
        except ValueError as error:
            return Rejected(self.topic.name, "attachment", f"{self.topic.name}: {error}")
        payload = sample.payload.to_bytes()
        message = decode(self.topic, payload, encoding)
        if isinstance(message, Rejected):
            return message
        return Received(message, payload, envelope, time.time_ns(), time.monotonic_ns())

    def _is_from_history(self, envelope: Envelope | None) -> bool:
        """Whether this message was already in the history of its publisher."""
        return envelope is not None and envelope.sequence < self._history_until.get(
            envelope.publisher, 0
        )

    def _gap_before(self, envelope: Envelope) -> int:
        """Number of messages that are missing before this one in its publisher's sequence."""
        expected = self._next_sequence.pop(envelope.publisher, envelope.sequence)
        self._next_sequence[envelope.publisher] = max(expected, envelope.sequence + 1)
        if len(self._next_sequence) > _PUBLISHERS:
            self._next_sequence.popitem(last=False)
        return max(0, envelope.sequence - expected)


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
        recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
    )
