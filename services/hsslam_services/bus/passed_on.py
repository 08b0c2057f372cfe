"""Requests that the gateway passes on to another process of the run, on keys closed to clients."""

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

import zenoh

from hsslam_node.errors import UserError
from hsslam_proto.codec import Rejected, decode, encode, encoding_of
from hsslam_proto.message import Message
from hsslam_proto.request_messages import Refusal
from hsslam_proto.requests import REFUSAL, Request
from hsslam_services.bus.answer_thread import AnswerThread

Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)

_SOONER_S = 1.0  # before the client gives up


def _key(request: Request, robot: str) -> str:
    """Two levels below `sys/`: the roles of clients cover one level."""
    return f"hsslam/{robot}/sys/passed_on/{request.name}"


class PassedOnAnswers(Generic[Q, A]):
    """Answers a request for the gateway; created by `Bus.answer`.

    `make` runs in a thread of its own, in the order of the questions; it raises `UserError` for a malformed
    one. The end of the process does not wait for an answer.
    """

    def __init__(
        self,
        session: zenoh.Session,
        robot: str,
        request: Request[Q, A],
        make: Callable[[Q], A | Refusal],
    ) -> None:
        self._request = request
        self._make = make
        self._answers = AnswerThread()
        self._under_way = threading.Lock()  # held from `_take` to the answer if one at a time
        self._queryable = session.declare_queryable(_key(request, robot), self._take)

    def close(self) -> None:
        """Stop answering."""
        self._queryable.undeclare()
        self._answers.close()

    def _take(self, query: zenoh.Query) -> None:
        """Leave the query to the thread: the end of a process waits for the threads of zenoh."""
        if self._request.one_at_a_time and not self._under_way.acquire(blocking=False):
            self._reply(query, self._request.busy)
        elif not self._answers.do(lambda: self._answer(query)):
            query.drop()

    def _answer(self, query: zenoh.Query) -> None:
        try:
            made = self._made(query)
        finally:
            if self._request.one_at_a_time:
                self._under_way.release()
        self._reply(query, made)

    def _reply(self, query: zenoh.Query, made: A | Refusal) -> None:
        with query, contextlib.suppress(zenoh.ZError):  # the gateway is gone
            if isinstance(made, Refusal):
                query.reply_err(
                    encode(REFUSAL, made), encoding=zenoh.Encoding(encoding_of(REFUSAL))
                )
                return
            encoding = zenoh.Encoding(encoding_of(self._request.answered))
            query.reply(query.key_expr, encode(self._request.answered, made), encoding=encoding)

    def _made(self, query: zenoh.Query) -> A | Refusal:
        payload = b"" if query.payload is None else query.payload.to_bytes()
        asked = decode(self._request.asked, payload, str(query.encoding))
        if isinstance(asked, Rejected):  # the gateway never sends one
            return Refusal(reason="malformed", text=asked.text)
        try:
            return self._make(asked)
        except UserError as error:
            return Refusal(reason="malformed", text=f"{self._request.name}: {error}"[:4096])
        except Exception as error:  # the client waits for an answer
            return Refusal(reason="failed", text=f"{self._request.name}: {error}"[:4096])


def pass_on(session: zenoh.Session, robot: str, request: Request[Q, A], message: Q) -> A | Refusal:
    """Ask the process that answers this request; gives up 1 s before `request.takes_s`, so that the client
    still gets a refusal: `unfinished`, as a busy process answers later, or `not_now`, if it does not run."""
    patience_s = request.takes_s - _SOONER_S
    asked_s = time.monotonic()
    replies = session.get(
        _key(request, robot),
        payload=encode(request.asked, message),
        encoding=zenoh.Encoding(encoding_of(request.asked)),
        timeout=patience_s,
    )
    for reply in replies:
        if reply.ok is not None:
            sample = reply.ok
            answer = decode(request.answered, sample.payload.to_bytes(), str(sample.encoding))
            if not isinstance(answer, Rejected):
                return answer
        elif reply.err is not None and str(reply.err.encoding) == encoding_of(REFUSAL):
            refusal = decode(REFUSAL, reply.err.payload.to_bytes(), str(reply.err.encoding))
            if not isinstance(refusal, Rejected):
                return refusal
    if time.monotonic() - asked_s < patience_s:
        text = f"{request.name}: the process that answers it is not running: ask again later"
        return Refusal(reason="not_now", text=text)
    return Refusal(
        reason="unfinished", text=f"{request.name}: the process that answers it is busy: ask again"
    )
