"""Receives and answers requests; refuses and counts malformed ones at once."""

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zenoh

from hsslam_node.errors import did_you_mean
from hsslam_proto.codec import Payload, Rejected, decode, encode, encoding_of
from hsslam_proto.message import Message
from hsslam_proto.request_messages import Refusal
from hsslam_proto.requests import REFUSAL, REQUESTS, Request, rpc_prefix
from hsslam_services.bus.answer_thread import AnswerThread

_LONGEST_QUEUE = 64  # waiting requests; further ones are refused as busy
_RING = 4096  # queries between two reads of the reader thread


@dataclass(frozen=True)
class PendingRequest:
    """A request that waits for its answer."""

    request: Request
    message: Any  # of the request's type
    _query: zenoh.Query
    _queue: "RequestQueue"

    def answer(self, message: Message) -> None:
        """Send the answer in the answer thread; an answer above the size limit becomes a refusal."""
        self._queue.later(self._query, lambda: self.answer_here(message))

    def answer_here(self, message: Message) -> None:
        """Send the answer in this thread: a large answer takes seconds and must not delay others."""
        try:
            payload = encode(self.request.answered, message)
        except ValueError as error:
            self.refuse("size", str(error))
            return
        except Exception as error:  # the client waits for an answer
            self.refuse("failed", f"{self.request.name}: {error}")
            return
        encoding = zenoh.Encoding(encoding_of(self.request.answered))
        with contextlib.suppress(zenoh.ZError):  # the client is gone
            self._query.reply(self._query.key_expr, payload, encoding=encoding)
        self._query.drop()

    def refuse(self, reason: Any, text: str) -> None:
        """Refuse the request; `text` is one line."""
        self._queue.refuse(self._query, reason, text)


class RequestQueue:
    """The requests to one robot, oldest first; created by `Bus.requests`.

    Counters: `received` and `refused`.
    """

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self.received = 0
        self.refused = 0
        self._prefix = rpc_prefix(robot)
        self._waiting: deque[PendingRequest] = deque()
        ring = zenoh.handlers.RingChannel(_RING)
        self._queryable = session.declare_queryable(f"{self._prefix}**", ring)
        self._lock = threading.Lock()
        self._answers = AnswerThread()
        self._thread = threading.Thread(
            target=self._read, args=(self._queryable.handler,), name="requests", daemon=True
        )
        self._thread.start()

    def poll(self) -> PendingRequest | None:
        """The oldest waiting request, or None; does not wait."""
        try:
            return self._waiting.popleft()
        except IndexError:
            return None

    def refuse(self, query: zenoh.Query, reason: Any, text: str) -> None:
        """Answer a query with a refusal in the answer thread, and count it."""
        with self._lock:
            self.refused += 1
        payload = encode(REFUSAL, Refusal(reason=reason, text=text[:4096]))

        def send() -> None:
            with contextlib.suppress(zenoh.ZError):
                query.reply_err(payload, encoding=zenoh.Encoding(encoding_of(REFUSAL)))
            query.drop()

        self.later(query, send)

    def later(self, query: zenoh.Query, send: Callable[[], None]) -> None:
        """Send an answer in the answer thread; if its queue is full, the client gets no answer."""
        if not self._answers.do(send):
            query.drop()

    def close(self) -> None:
        """Stop answering."""
        self._answers.close()
        self._queryable.undeclare()
        self._thread.join(timeout=2.0)

    def _read(self, handler: "zenoh.Handler[zenoh.Query]") -> None:
        while True:
            try:
                query = handler.recv()
            except zenoh.ZError:  # undeclared, or the session is closed
                return
            self.received += 1
            self._take(query)
            del query

    def _take(self, query: zenoh.Query) -> None:
        name = str(query.key_expr).removeprefix(self._prefix)
        request = next((request for request in REQUESTS if request.name == name), None)
        if request is None:
            self.refuse(query, "unknown", _unknown(name))
            return
        message = _read_message(request.asked, query)
        if isinstance(message, Rejected):
            self.refuse(query, message.reason, message.text)
        elif len(self._waiting) >= _LONGEST_QUEUE:
            self.refuse(query, "busy", f"{request.asked.name}: {_LONGEST_QUEUE} requests wait")
        else:
            self._waiting.append(PendingRequest(request, message, query, self))


def _read_message(asked: Payload, query: zenoh.Query) -> Message | Rejected:
    """The message in a query; no payload: the message with default fields."""
    payload = query.payload
    if payload is None or len(payload) == 0:
        try:
            return asked.message()
        except TypeError:
            text = f"{asked.name}: no payload: expected {asked.schema}"
            return Rejected(asked.name, "malformed", text)
    encoding = "" if query.encoding is None else str(query.encoding)
    if len(payload) > asked.size_limit_bytes:  # before it is copied
        text = f"{asked.name}: {len(payload)} bytes: expected at most {asked.size_limit_bytes}"
        return Rejected(asked.name, "size", text)
    return decode(asked, payload.to_bytes(), encoding)


def _unknown(name: str) -> str:
    names = [request.name for request in REQUESTS]
    hint = did_you_mean(name, names) or f"; known: {', '.join(names)}"
    return f"rpc/{name:.64}: unknown request{hint}"
