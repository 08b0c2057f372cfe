"""The answering end of the requests, on a real bus."""

import random
import time

import pytest
import zenoh

from hsslam_proto.codec import decode, encode, encoding_of
from hsslam_proto.request_messages import Ask, Done, Refusal, SaveMap
from hsslam_proto.requests import PAUSE, REFUSAL, REQUESTS, SAVE
from hsslam_services.bus.bus import Bus, free_endpoint, open_router
from hsslam_services.bus.zenoh_session import open_client


@pytest.fixture
def ends():
    endpoint = free_endpoint()
    router = open_router(endpoint)
    with Bus(endpoint, "r", "supervisor") as bus, open_client(endpoint) as client:
        queue = bus.requests()
        _settle(client)
        yield queue, client
    router.close()


def test_a_request_is_answered(ends):
    queue, client = ends
    replies = client.get("hsslam/r/rpc/pause")  # without a payload, as from a shell
    _next(queue).answer(Done(text="paused"))
    (reply,) = list(replies)
    assert decode(PAUSE.answered, reply.ok.payload.to_bytes(), str(reply.ok.encoding)) == Done(
        text="paused"
    )


def test_arguments_arrive(ends):
    queue, client = ends
    wanted = SaveMap(name="kitchen", replace=True)
    client.get(
        SAVE.key("r"),
        payload=encode(SAVE.asked, wanted),
        encoding=zenoh.Encoding(encoding_of(SAVE.asked)),
    )
    asked = _next(queue)
    assert (asked.request, asked.message) == (SAVE, wanted)


@pytest.mark.parametrize(
    ("name", "payload", "encoding", "reason"),
    [
        ("stat", b"", "", "unknown"),
        ("*", b"", "", "unknown"),
        ("save/a", b"", "", "unknown"),
        ("save", b"", "", "malformed"),
        ("save", b"\x80", "hsslam.SaveMap.v1", "malformed"),
        ("save", b"\x81\xa4name\xa2..", "hsslam.SaveMap.v1", "malformed"),
        ("save", b"\x81\xa4name\xa3a/b", "hsslam.SaveMap.v1", "malformed"),
        ("save", b"\x81\xa4name\xa2a\n", "hsslam.SaveMap.v1", "malformed"),
        ("save", b"\x80", "hsslam.Ask.v1", "schema"),
        ("set-mode", b"", "", "malformed"),
        ("set-mode", b"\x81\xa4mode\xa3off", "hsslam.SetMode.v1", "malformed"),
        ("set-mode", b"\x82\xa4mode\xa7mapping\xa4more\x01", "hsslam.SetMode.v1", "malformed"),
        ("stop", b"\x81\xa4more\x01", "hsslam.Ask.v1", "malformed"),
        ("stop", b"\x80", "hsslam.Ask.v2", "version"),
        ("stop", b"\x80" * 10_000, "hsslam.Ask.v1", "size"),
        ("stop", b"\xc1", "hsslam.Ask.v1", "malformed"),
        ("stop", b"\x80", "", "encoding"),
    ],
)
def test_what_cannot_be_read_is_refused(ends, name, payload, encoding, reason):
    queue, client = ends
    refused = queue.refused
    media = f"application/msgpack;{encoding}" if encoding else "zenoh/bytes"
    (reply,) = list(
        client.get(f"hsslam/r/rpc/{name}", payload=payload, encoding=zenoh.Encoding(media))
    )
    refusal = decode(REFUSAL, reply.err.payload.to_bytes(), str(reply.err.encoding))
    assert isinstance(refusal, Refusal)
    assert refusal.reason == reason
    assert "\n" not in refusal.text and len(refusal.text) < 400
    assert queue.refused == refused + 1
    assert queue.poll() is None


def test_noise_on_every_request_is_counted(ends):
    queue, client = ends
    rng = random.Random(0)
    received, refused = queue.received, queue.refused
    for _ in range(200):
        replies = []
        for k in range(50):
            request = REQUESTS[k % len(REQUESTS)]
            right = encoding_of(request.asked)
            encoding = zenoh.Encoding(rng.choice([right, right, "zenoh/bytes", f"{right[:-1]}7"]))
            payload = b"\xc1" + rng.randbytes(rng.choice([1, 10, 200, 5000]))
            replies.append(client.get(request.key("r"), payload=payload, encoding=encoding))
        assert all(next(iter(reply)).err is not None for reply in replies)
    assert queue.received - received == queue.refused - refused == 10_000
    assert queue.poll() is None


def test_more_requests_than_can_wait_are_refused_as_busy(ends):
    queue, client = ends
    replies = [client.get("hsslam/r/rpc/pause") for _ in range(80)]
    _wait(lambda: queue.received >= 80)
    while (asked := queue.poll()) is not None:
        _wait(queue._answers._jobs.empty)  # beyond 64 that wait, answers are left out
        asked.answer(Done(text=""))
    answers = [next(iter(reply)) for reply in replies]
    refusals = [
        decode(REFUSAL, a.err.payload.to_bytes(), str(a.err.encoding)) for a in answers if a.err
    ]
    assert len(answers) - len(refusals) >= 64
    assert refusals and {refusal.reason for refusal in refusals} == {"busy"}


def test_an_empty_payload_is_an_empty_request(ends):
    queue, client = ends
    client.get("hsslam/r/rpc/status")
    assert _next(queue).message == Ask()


def _settle(client) -> None:
    """Until the queryable is known: an unknown request is refused."""
    _wait(lambda: list(client.get("hsslam/r/rpc/nothing")))


def _next(queue):
    found = []
    _wait(lambda: found or found.extend(filter(None, [queue.poll()])) or found)
    return found[0]


def _wait(condition) -> None:
    deadline = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)
