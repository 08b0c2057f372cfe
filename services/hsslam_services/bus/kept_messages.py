"""What publishers keep for subscribers that come later: the last messages of a topic, or its state."""

from collections.abc import Iterator

import zenoh

_CACHES = "@adv/**"  # where zenoh's AdvancedPublisher answers, below the key of its topic
_STATE_S = 10.0  # for a publisher to answer


def get_history(session: zenoh.Session, key: str) -> Iterator[zenoh.Sample]:
    """The messages that publishers of a topic with history keep, those of each in their order.

    zenoh's own subscriber with history loses it if a message or a heartbeat comes before the answer
    (zenoh 1.10: one start in five while messages come).

    Raises:
        zenoh.ZError: the session is closed.
    """
    yield from _replies(session, f"{key}/{_CACHES}", None)


def get_state(
    session: zenoh.Session, key: str, timeout_s: float = _STATE_S
) -> Iterator[zenoh.Sample]:
    """What the publisher of a topic that keeps its state answers: none, if there is no publisher.

    Raises:
        zenoh.ZError: the session is closed.
    """
    yield from _replies(session, key, timeout_s)


def _replies(session: zenoh.Session, key: str, timeout_s: float | None) -> Iterator[zenoh.Sample]:
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
