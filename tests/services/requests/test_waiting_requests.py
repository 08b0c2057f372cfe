"""Requests are answered in turn, and one that fails costs no other."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from hsslam_proto.point_codec import question_message, question_points
from hsslam_proto.requests import QUERY
from hsslam_services.bus.ask import NoServiceError, RefusedError, ask
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.requests.waiting_requests import WaitingRequests


def _answer(asked: PendingRequest) -> None:
    x = question_points(asked.message)[0, 0]
    if x < 0:
        raise RuntimeError("the link is gone")
    asked.refuse("not_now", f"query: answered {x:g}")


@contextmanager
def _asked(endpoint: str) -> Iterator[Callable[[float], str]]:
    """A function that asks about a point with this x, and returns the answer."""

    def told(x: float) -> str:
        while True:
            try:
                ask(endpoint, "r", QUERY, question_message(np.array([[x, 0.0, 0.0]])))
            except RefusedError as refusal:
                return str(refusal)
            except NoServiceError:  # the router knows the gateway a moment later
                continue

    is_over = threading.Event()
    with Bus(endpoint, "r", "supervisor") as bus:
        requests, waiting = bus.requests(), WaitingRequests("test", _answer)

        def turn() -> None:
            while not is_over.wait(0.005):
                if (asked := requests.poll()) is not None:
                    waiting.add(asked)

        loop = threading.Thread(target=turn)
        loop.start()
        try:
            yield told
        finally:
            is_over.set()
            loop.join()


def test_an_answer_that_fails_is_refused_and_the_next_is_given(endpoint: str):
    with _asked(endpoint) as told:
        assert "query: the link is gone" in told(-1.0)
        assert "query: answered 3" in told(3.0)


def test_a_thread_that_cannot_start_costs_one_request(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
):
    start, failures = threading.Thread.start, [RuntimeError("can't start new thread")]

    def start_later(thread: threading.Thread) -> None:
        if failures and thread.name == "test":
            raise failures.pop()
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", start_later)
    with _asked(endpoint) as told:
        assert "query: RuntimeError: can't start new thread" in told(2.0)
        assert "query: answered 3" in told(3.0)
