"""A TCP link to a router, slow in its direction, as a network is."""

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

_PART = 2**14
_WINDOW = 2**16


@contextmanager
def slow_link(endpoint: str, mbit_s: float) -> Iterator[str]:
    """The endpoint for a client; its socket holds 64 KiB, as loopback would take whole frames at once."""
    with socket.socket() as door:
        door.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _WINDOW)
        door.bind(("127.0.0.1", 0))
        door.listen()
        threading.Thread(target=_accept, args=(door, endpoint, mbit_s), daemon=True).start()
        yield f"tcp/127.0.0.1:{door.getsockname()[1]}#so_sndbuf={_WINDOW}"


def _accept(door: socket.socket, endpoint: str, mbit_s: float) -> None:
    host, port = endpoint.partition("/")[2].rsplit(":", 1)
    with contextlib.suppress(OSError):  # the door is closed
        while True:
            near, _ = door.accept()
            far = socket.create_connection((host, int(port)))
            for one, other, most in ((near, far, mbit_s), (far, near, float("inf"))):
                threading.Thread(target=_pass_on, args=(one, other, most), daemon=True).start()


def _pass_on(one: socket.socket, other: socket.socket, mbit_s: float) -> None:
    free_s = time.monotonic()
    with one, other, contextlib.suppress(OSError):
        while part := one.recv(_PART):
            free_s = max(free_s, time.monotonic()) + 8e-6 * len(part) / mbit_s
            time.sleep(max(0.0, free_s - time.monotonic()))
            other.sendall(part)
