"""An S3 server on this machine, and a proxy before it that fails some requests and breaks off others."""

import http.client
import itertools
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlsplit

import pytest

BUCKET = "fleet"


@contextmanager
def object_store() -> Iterator[tuple[str, Any]]:
    """Its address, and a client; it has an empty bucket."""
    import boto3
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    url = f"http://{host}:{port}"
    keys = {"aws_access_key_id": "a", "aws_secret_access_key": "b", "region_name": "us-east-1"}
    # all servers of a process have the same buckets
    urllib.request.urlopen(urllib.request.Request(f"{url}/moto-api/reset", method="POST"))
    client = boto3.client("s3", endpoint_url=url, **keys)
    client.create_bucket(Bucket=BUCKET)
    try:
        yield url, client
    finally:
        server.stop()


def reach(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on s3fs, in this process and those that it starts, finds the server at this address."""
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    names = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_DEFAULT_REGION")
    for name, value in zip(names, ("a", "b", "us-east-1"), strict=True):
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("AWS_ENDPOINT_URL", url)
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")  # the client hides fewer faults


class Faults:
    """Of all requests for objects each `every`-th is refused, and the next of them ends half-way.

    `of_all`: of those that write, list and remove, too. Of writes that end half-way one in two comes to the
    server whole, and only its answer is lost. `ranges`: the ranges that were asked for, by path, in order.
    While `away` is positive, requests are refused and it is counted down. `closed`: path of what no user may
    read, or the beginning of its path.
    """

    def __init__(
        self, every: int, *, of_all: bool = False, away: float = 0, closed: str = ""
    ) -> None:
        self.of_all = of_all
        self.away = away
        self.closed = closed
        self._lock = threading.Lock()
        self._turns = itertools.cycle(range(2 * every))
        self._every = every
        self.refused = 0
        self.broken = 0
        self.ranges: list[tuple[str, str]] = []

    def next(self) -> str:
        """What happens to the next request."""
        with self._lock:
            if self.away > 0:
                self.away -= 1
                self.refused += 1
                return "refuse"
            turn = next(self._turns)
            kind = {self._every - 1: "refuse", 2 * self._every - 1: "break"}.get(turn, "pass")
            self.refused += kind == "refuse"
            self.broken += kind == "break"
            return kind


@contextmanager
def faulty(url: str, faults: Faults) -> Iterator[str]:
    """The address of a proxy before the server."""
    place = urlsplit(url).netloc

    class Proxy(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            self._pass_on()

        do_HEAD = do_PUT = do_POST = do_DELETE = do_GET

        def log_message(self, format: str, *args: Any) -> None:
            pass

        def _pass_on(self) -> None:
            asked = self.headers.get("Range", "")
            is_object = faults.of_all or (self.command == "GET" and bool(asked))
            kind = faults.next() if is_object else "pass"
            if is_object:
                faults.ranges.append((self.path, asked))
            nbytes = int(self.headers.get("Content-Length", 0))
            is_cut = kind == "break" and nbytes > 0
            if is_cut and faults.broken % 2:
                self.rfile.read(nbytes // 2)
                self.close_connection = True
                return
            sent = self.rfile.read(nbytes)
            if faults.closed and self.path.startswith(faults.closed):
                self.send_error(403)
                return
            if kind == "refuse":
                self.send_error(503)
                return
            there = http.client.HTTPConnection(place)
            there.request(self.command, self.path, sent or None, dict(self.headers))
            answer = there.getresponse()
            body = answer.read()
            if is_cut:
                self.close_connection = True
                return
            self.send_response(answer.status)
            for name, value in answer.getheaders():
                if name.lower() not in ("transfer-encoding", "connection", "content-length"):
                    self.send_header(name, value)
            length = answer.getheader("Content-Length") if self.command == "HEAD" else len(body)
            self.send_header("Content-Length", str(length))
            self.end_headers()
            self.wfile.write(body[: len(body) // 2] if kind == "break" else body)
            self.close_connection = kind == "break"
            there.close()

    server = ThreadingHTTPServer(("127.0.0.1", 0), Proxy)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
