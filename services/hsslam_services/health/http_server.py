"""`/metrics` and `/healthz` over HTTP, served by threads that never wait for the supervisor's loop."""

import contextlib
import json
import socket
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any

from hsslam_node.errors import UserError
from hsslam_services.health.snapshot import Snapshot, health_of

_EVERY_S = 0.5
_SLOWEST_CLIENT_S = 5.0
_MOST_CONNECTIONS = 16  # each holds a descriptor and a thread of the supervisor
_JSON = "application/json"


class MetricsServer:
    """Serves the newest snapshot on 127.0.0.1; does nothing if `port` is None.

    Raises:
        UserError: the port is taken.
    """

    def __init__(self, port: int | None) -> None:
        self._server: _Server | None = None
        self._due_s = 0.0
        if port is None:
            return
        import hsslam_services.health.prometheus  # noqa: F401, for the first request

        try:
            self._server = _Server(("127.0.0.1", port), _Handler)
        except OSError as error:
            text = f"--metrics-port {port}: {error.strerror}: expected a free port"
            raise UserError(text) from None
        threading.Thread(target=self._server.serve_forever, name="metrics", daemon=True).start()

    def tick(self, take: Callable[[], Snapshot]) -> None:
        """Take a snapshot if one is due; never blocks."""
        now_s = time.monotonic()
        if self._server is not None and now_s >= self._due_s:
            self._due_s = now_s + _EVERY_S
            self._server.snapshot = take()

    def close(self) -> None:
        """Stop the server."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()


class _Server(ThreadingTCPServer):
    """Not wsgiref's server, which looks up this machine's name before it listens.

    Not prometheus_client's WSGI application either, which refuses HEAD. One connection too many closes the
    oldest one, so idle connections do not block new clients.
    """

    allow_reuse_address = True
    daemon_threads = True
    snapshot: Snapshot | None = None

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self._lock = threading.Lock()
        self._open: dict[socket.socket, None] = {}  # oldest first
        super().__init__(address, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve the request in another thread."""
        with self._lock:
            self._open[request] = None
            if len(self._open) > _MOST_CONNECTIONS:
                oldest = next(iter(self._open))
                del self._open[oldest]
                with contextlib.suppress(OSError):
                    oldest.shutdown(socket.SHUT_RDWR)  # its thread closes it
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Close the connection, at the end of its thread."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore the errors of clients that are gone."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server  # type: ignore[assignment]
    timeout = _SLOWEST_CLIENT_S

    def do_GET(self) -> None:
        from hsslam_services.health.prometheus import exposition

        snapshot = self.server.snapshot
        match self.path.partition("?")[0]:
            case "/metrics":
                self._send(200, *exposition(snapshot, self.headers.get("Accept", "")))
            case "/healthz":
                code, body = health_of(snapshot)
                self._send(code, json.dumps(body).encode() + b"\n", _JSON)
            case _:
                self._send(404, b'{"error": "expected /metrics or /healthz"}\n', _JSON)

    do_HEAD = do_GET

    def _send(self, code: int, body: bytes, content_type: str) -> None:
        self.send_response(code)
        self.send_header("Content-Type", content_type)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Do not log requests: a scrape comes every few seconds."""
