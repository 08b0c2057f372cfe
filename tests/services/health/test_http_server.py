"""The HTTP side, asked over a socket."""

import http.client
import json
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_services.bus.bus import free_endpoint
from hsslam_services.health.http_server import MetricsServer
from tests.repository import ROOT
from tests.services.health.sample_snapshot import taken_at


@pytest.fixture
def port() -> int:
    return int(free_endpoint().rpartition(":")[2])


@pytest.fixture
def server(port: int) -> Iterator[MetricsServer]:
    started = MetricsServer(port)
    yield started
    started.close()


def _get(port: int, path: str) -> tuple[int, bytes]:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=10) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def test_the_last_snapshot_is_served(server, port):
    assert _get(port, "/healthz")[0] == 503
    server.tick(lambda: taken_at(time.monotonic()))
    code, body = _get(port, "/healthz")
    assert (code, json.loads(body)["status"]) == (200, "ok")
    code, body = _get(port, "/metrics")
    assert code == 200 and b"hsslam_frames_tracked_total 96.0" in body
    assert _get(port, "/etc/passwd")[0] == 404
    taken: list[int] = []
    server.tick(lambda: taken.append(1) or taken_at(0.0))
    assert not taken  # the next is not due yet


def test_the_page_shows_every_field_of_the_answer(server, port):
    server.tick(lambda: taken_at(time.monotonic()))
    fields = json.loads(_get(port, "/healthz")[1]).keys()
    page = (ROOT / "docs/monitoring.md").read_text()
    shown = [json.loads(line) for line in page.splitlines() if line.startswith('{"status"')]
    assert len(shown) == 2 and all(answer.keys() == fields for answer in shown)


def test_other_ways_of_asking(server, port):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("HEAD", "/metrics")
    assert connection.getresponse().status == 200
    connection.request("POST", "/metrics")
    assert connection.getresponse().status == 501


def test_idle_connections_are_bounded_and_keep_no_client_from_an_answer(server, port):
    before = len(list(Path("/proc/self/fd").iterdir()))
    idle = [socket.create_connection(("127.0.0.1", port), timeout=10) for _ in range(100)]
    assert _get(port, "/healthz")[0] == 503
    deadline = time.monotonic() + 10
    while len(list(Path("/proc/self/fd").iterdir())) > before + len(idle) + 20:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert idle[0].recv(1) == b""  # the oldest was closed
    for connection in idle:
        connection.close()


def test_a_busy_port_is_one_line(server, port):
    with pytest.raises(UserError, match=f"--metrics-port {port}: .*expected a free port"):
        MetricsServer(port)


def test_off_is_off():
    off = MetricsServer(None)
    off.tick(lambda: pytest.fail("a snapshot was taken"))
    off.close()
