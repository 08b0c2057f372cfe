"""An HTTP server on this machine that breaks off half-way, and knows what it was asked."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest


@dataclass
class BreakingServer:
    """Serves `files` (by path); each of the next answers ends after the number of bytes in `breaks`."""

    files: dict[str, bytes]
    breaks: list[int] = field(default_factory=list)
    knows_ranges: bool = True
    status: int = 200
    asked: list[tuple[str, str | None]] = field(default_factory=list)  # path, Range
    url: str = ""


@pytest.fixture
def serve_files() -> Iterator[Callable[..., BreakingServer]]:
    running = []

    def start(files: dict[str, bytes], **settings: Any) -> BreakingServer:
        state = BreakingServer(files, **settings)
        http = ThreadingHTTPServer(("127.0.0.1", 0), _handler(state))
        state.url = f"http://127.0.0.1:{http.server_port}"
        threading.Thread(target=http.serve_forever, args=(0.01,), daemon=True).start()
        running.append(http)
        return state

    yield start
    for http in running:
        http.shutdown()
        http.server_close()


def _handler(state: BreakingServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            wanted = self.headers.get("Range")
            state.asked.append((self.path, wanted))
            data = state.files.get(self.path)
            if data is None or state.status != 200:
                self.send_error(404 if data is None else state.status)
                return
            first = 0
            if wanted and state.knows_ranges:
                first = int(wanted.removeprefix("bytes=").removesuffix("-"))
                if first >= len(data):
                    self.send_response(416)
                    self.send_header("Content-Range", f"bytes */{len(data)}")
                    self.end_headers()
                    return
                self.send_response(206)
                self.send_header("Content-Range", f"bytes {first}-{len(data) - 1}/{len(data)}")
            else:
                self.send_response(200)
            self.send_header("Content-Length", str(len(data) - first))
            self.end_headers()
            most = state.breaks.pop(0) if state.breaks else len(data)
            self.wfile.write(data[first : first + most])

        def log_message(self, format: str, *args: object) -> None:
            pass

    return Handler
