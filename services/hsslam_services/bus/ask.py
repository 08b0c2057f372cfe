"""Sends a request to a running service; no service, a refusal and a timeout are different errors."""

from typing import TypeVar

import zenoh

from hsslam_node.errors import UserError
from hsslam_proto.codec import Rejected, decode, encode, encoding_of
from hsslam_proto.message import Message
from hsslam_proto.request_messages import Refusal
from hsslam_proto.requests import REFUSAL, Request
from hsslam_services.bus.zenoh_session import open_client
from hsslam_services.security.credentials import client_settings

Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)
_CONNECT_S = 3.0


class NotDoneError(Exception):
    """A request that failed; the first words of the text name the kind: no service, refused, timeout."""


class NoServiceError(NotDoneError):
    """There is no router, or no service of this robot behind it."""


class RefusedError(NotDoneError):
    """The service refused the request."""


class UnfinishedError(RefusedError):
    """The service has done a part of the work; ask again to continue."""


class NoAnswerError(NotDoneError):
    """The service did not answer in time."""


def ask(
    endpoint: str,
    robot: str,
    request: Request[Q, A],
    message: Q,
    timeout_s: float | None = None,
    connect_s: float = _CONNECT_S,
    security: str = "",
) -> A:
    """Ask the service behind the router at `endpoint`; waits `request.takes_s` by default.

    `security`: folder of the certificate for an endpoint `tls/HOST:PORT`.

    Raises:
        NoServiceError, RefusedError, UnfinishedError, NoAnswerError: one line each.
        UserError: the certificate cannot be used.
    """
    wait_s = request.takes_s if timeout_s is None else timeout_s
    settings = client_settings(endpoint, security)
    try:
        session = open_client(endpoint, connect_s, settings)
    except UserError as error:
        raise NoServiceError(f"no service: {error}") from None
    with session:
        replies = session.get(
            request.key(robot),
            payload=encode(request.asked, message),
            encoding=zenoh.Encoding(encoding_of(request.asked)),
            timeout=wait_s,
        )
        for reply in replies:
            if reply.ok is not None:
                return _answer(request, reply.ok.payload.to_bytes(), str(reply.ok.encoding))
            assert reply.err is not None
            _raise_refusal(request, reply.err, wait_s)
    refused = f", or this certificate does not allow the request {request.name}" if security else ""
    raise NoServiceError(f"no service: no run of robot {robot!r} at {endpoint}{refused}")


def _answer(request: Request[Q, A], payload: bytes, encoding: str) -> A:
    answer = decode(request.answered, payload, encoding)
    if isinstance(answer, Rejected):
        raise RefusedError(f"refused: cannot decode the answer: {answer.text}")
    return answer


def _raise_refusal(request: Request, error: zenoh.ReplyError, wait_s: float) -> None:
    if str(error.encoding) != encoding_of(REFUSAL):  # an error of zenoh, not of the service
        raise NoAnswerError(f"timeout: no answer to {request.name} within {wait_s:g} s")
    refusal = decode(REFUSAL, error.payload.to_bytes(), str(error.encoding))
    is_begun = isinstance(refusal, Refusal) and refusal.reason == "unfinished"
    raise (UnfinishedError if is_begun else RefusedError)(f"refused: {refusal.text}")
