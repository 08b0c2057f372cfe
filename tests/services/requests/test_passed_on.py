"""Questions of places from a client by way of the gateway to the process that has the map, and back."""

import dataclasses
import queue
import re
import threading
from collections.abc import Iterator

import numpy as np
import pytest
import zenoh

from hsslam_node.dense_map.answers import MapAnswers
from hsslam_node.errors import UserError
from hsslam_proto.codec import encode, encoding_of
from hsslam_proto.point_codec import answers_message, answers_of, question_message, question_points
from hsslam_proto.request_messages import Locate, PointAnswers, QueryMap, Refusal
from hsslam_proto.requests import LOCATE, QUERY, REFUSAL
from hsslam_services.bus.ask import NoServiceError, NotDoneError, RefusedError, ask
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.zenoh_session import open_client
from hsslam_services.requests.passed_on import PassedOn
from tests.repository import ROOT

POINTS = np.arange(12, dtype=np.float32).reshape(4, 3)


def _answer(question: QueryMap) -> PointAnswers:
    """Distances that are the points' x."""
    points = question_points(question)
    if (points < 0).any():
        raise UserError("points below 0: expected others")
    n = len(points)
    known = np.ones(n, np.bool_)
    return answers_message(MapAnswers(points[:, 0], 2 * points, known, points[:, 1]), 7, 1)


@pytest.fixture
def gateway(endpoint) -> Iterator[str]:
    """A gateway that takes requests until the test ends; returns where."""
    with Bus(endpoint, "r", "supervisor") as bus:
        requests = bus.requests()
        passed_on = {request.name: PassedOn(bus, request) for request in (QUERY, LOCATE)}
        is_over = threading.Event()

        def turn() -> None:
            while not is_over.wait(0.005):
                if (asked := requests.poll()) is not None:
                    passed_on[asked.request.name].ask(asked)

        loop = threading.Thread(target=turn)
        loop.start()
        yield endpoint
        is_over.set()
        loop.join()


def _ask(endpoint: str, points: np.ndarray) -> PointAnswers:
    while True:
        try:
            return ask(endpoint, "r", QUERY, question_message(points))
        except NoServiceError:  # the router knows the gateway a moment later
            continue


def test_the_answer_comes_from_the_process_that_has_the_map(gateway):
    with Bus(gateway, "r", "mesher") as mesher:
        mesher.answer(QUERY, _answer)
        told = _ask(gateway, POINTS)
        many = _ask(gateway, np.ones((100_000, 3)))
    assert (told.count, told.map_version, told.map_epoch) == (4, 7, 1)
    found = answers_of(told)
    np.testing.assert_array_equal(found.distance_m, POINTS[:, 0])
    np.testing.assert_array_equal(found.gradient, 2 * POINTS)
    np.testing.assert_array_equal(found.certainty, POINTS[:, 1])
    assert found.known.all() and many.count == 100_000


def test_without_that_process_it_is_refused_at_once(gateway):
    with pytest.raises(RefusedError, match="query: the process that answers it is not running"):
        _ask(gateway, POINTS)


def test_while_that_process_is_busy_the_client_is_told_to_ask_again(gateway):
    is_over = threading.Event()
    with Bus(gateway, "r", "mesher") as mesher, Bus(gateway, "r", "asking") as asking:
        mesher.answer(QUERY, lambda _: is_over.wait() or _answer(_))
        quick = dataclasses.replace(QUERY, takes_s=1.5)
        while (refusal := asking.pass_on(quick, question_message(POINTS))).reason == "not_now":
            pass  # the router knows the mesher a moment later
        is_over.set()
    assert (refusal.reason, refusal.text) == (
        "unfinished",
        "query: the process that answers it is busy: ask again",
    )


def _located(endpoint: str, x: float) -> str:
    """The answer to a client that gives a place at x for the camera."""
    while True:
        try:
            return str(ask(endpoint, "r", LOCATE, Locate(x=x, y=0, yaw_deg=0)))
        except NoServiceError:  # the router knows the gateway a moment later
            continue
        except NotDoneError as error:
            if "is not running" not in str(error):  # and the tracker
                return str(error)


def test_while_one_client_is_answered_others_are_refused_at_once_and_their_questions_dropped(
    gateway,
):
    """Through the gateway, or from a process of the run, as a pose of `/initialpose` comes."""
    asked: queue.Queue[float] = queue.Queue()
    may_answer = threading.Event()
    told: list[str] = []

    def answer(question: Locate) -> Refusal:
        asked.put(question.x)
        assert may_answer.wait(60)
        return Refusal(reason="failed", text="locate: not found")

    busy = "locate: another client is being answered: expected one at a time"
    with Bus(gateway, "r", "tracker") as tracker, Bus(gateway, "r", "ros2_out") as ros:
        tracker.answer(LOCATE, answer)
        first = threading.Thread(target=lambda: told.append(_located(gateway, 1)))
        first.start()
        assert asked.get(timeout=60) == 1
        assert _located(gateway, 2) == f"refused: {busy}"
        while (refusal := ros.pass_on(LOCATE, Locate(x=3, y=0, yaw_deg=0))).reason == "not_now":
            pass  # the router knows the tracker a moment later
        assert (refusal.reason, refusal.text) == ("busy", busy)
        assert not told
        may_answer.set()
        first.join()
        assert told == [_located(gateway, 4)] == ["refused: locate: not found"]
    assert asked.get(timeout=60) == 4 and asked.empty()


def test_a_client_for_whom_no_thread_starts_does_not_keep_others_out(
    gateway, monkeypatch: pytest.MonkeyPatch
):
    start, failures = threading.Thread.start, [RuntimeError("can't start new thread")]

    def start_later(thread: threading.Thread) -> None:
        if failures and thread.name == LOCATE.name:
            raise failures.pop()
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", start_later)
    with Bus(gateway, "r", "tracker") as tracker:
        tracker.answer(LOCATE, lambda _: Refusal(reason="failed", text="locate: not found"))
        assert "can't start new thread" in _located(gateway, 1)
        assert _located(gateway, 2) == "refused: locate: not found"


def _client_of_the_document(endpoint: str) -> str:
    (block,) = re.findall(
        r"^```python\n(.*?)^```", (ROOT / "docs/wire.md").read_text(), re.M | re.S
    )
    code = block.replace("tcp/127.0.0.1:7447", endpoint).replace("hsslam/robot/", "hsslam/r/")
    assert code.count(endpoint) == 1 and code.count("hsslam/r/") == 1
    return code


@pytest.mark.parametrize("is_refused", [True, False])
def test_the_client_of_the_document_tells_a_refusal_and_no_answer(endpoint, is_refused):
    def answer(query: zenoh.Query) -> None:
        if is_refused:
            refusal = encode(REFUSAL, Refusal(reason="busy", text="query: later"))
            query.reply_err(refusal, encoding=zenoh.Encoding(encoding_of(REFUSAL)))
        else:
            query.reply_err(b"Timeout")  # as zenoh says it itself

    code = _client_of_the_document(endpoint)
    with open_client(endpoint) as service:
        queryable = service.declare_queryable(QUERY.key("r"), answer)
        with pytest.raises(SystemExit, match="query: later" if is_refused else "no answer in time"):
            while True:  # the router knows the service a moment later
                exec(compile(code, "docs/wire.md", "exec"), {})
        queryable.undeclare()


def test_the_client_of_the_document_is_answered(gateway, capsys):
    code = _client_of_the_document(gateway)
    told = question_message(np.abs(POINTS))
    with Bus(gateway, "r", "mesher") as mesher:
        mesher.answer(QUERY, lambda question: _answer(told))
        _ask(gateway, POINTS)  # the router knows all by now
        exec(compile(code, "docs/wire.md", "exec"), {})
    assert capsys.readouterr().out.startswith("7 [0. 3. 6. 9.] [[ 0.  2.  4.]")


@pytest.mark.parametrize(
    ("points", "text"),
    [(-POINTS, "query: points below 0: expected others"), (POINTS + 99, "query: out of luck")],
)
def test_what_goes_wrong_there_is_told(gateway, points, text):
    def answer(question: QueryMap) -> PointAnswers | Refusal:
        if question_points(question)[0, 0] > 50:
            raise RuntimeError("out of luck")
        return _answer(question)

    with Bus(gateway, "r", "mesher") as mesher:
        mesher.answer(QUERY, answer)
        with pytest.raises(RefusedError, match=text):
            _ask(gateway, points)
