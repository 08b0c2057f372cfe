"""Fetches what publishers keep for late subscribers: the last messages of a topic, or its state."""

from collections.abc import Generator, Iterator

import zenoh

_CACHES = "@adv/**"  # caches of zenoh's AdvancedPublisher, below the key of the topic
_STATE_S = 10.0  # time for a publisher to answer


class IncompleteStateError(Exception):
    """A publisher did not send all of its state in time."""


def get_history(session: zenoh.Session, key: str) -> Iterator[zenoh.Sample]:
    """The messages in the caches of a topic's publishers, in the order of each publisher.

    zenoh's own subscriber with history loses them if a message or a heartbeat comes before the answer
    (zenoh 1.10: one start in five while messages come).

    Raises:
        zenoh.ZError: the session is closed.
    """
    yield from _replies(session, f"{key}/{_CACHES}", None)


def get_state(
    session: zenoh.Session, key: str, timeout_s: float = _STATE_S
) -> Iterator[zenoh.Sample]:
    """The state of a topic that keeps its state, from its publisher; empty if there is no publisher.

    Raises:
        IncompleteStateError: after what came of it.
        zenoh.ZError: the session is closed.
    """
    if not (yield from _replies(session, key, timeout_s)):
        raise IncompleteStateError(key)


def _replies(
    session: zenoh.Session, key: str, timeout_s: float | None
) -> Generator[zenoh.Sample, None, bool]:
    """The replies; returns whether there was no error, such as a time-out, among them."""
    is_whole = True
    replies = session.get(
        key,
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,  # all replies have the same key
        accept_replies=zenoh.ReplyKeyExpr.ANY,  # a cache answers with the key of its topic
        timeout=timeout_s,
    )
    for reply in replies:
        if reply.ok is not None:
            yield reply.ok
        else:
            is_whole = False
    return is_whole
