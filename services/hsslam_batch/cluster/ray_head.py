"""Whether a Ray head answers at an address; Ray itself tries for minutes before it says that none does."""

import socket
from urllib.parse import urlsplit

from hsslam_node.environment import RAY_ADDRESS, RAY_TLS
from hsslam_node.errors import UserError

_ANSWER_S = 10.0
_CLIENT = "ray"  # the scheme of an address of Ray's client server
_CLIENT_PORT = 10001  # if the address has none
# Ray speaks gRPC, which is HTTP/2: both sides begin with a frame of settings
_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
_SETTINGS = b"\x04"
_NO_SETTINGS = b"\0\0\0" + _SETTINGS + b"\0\0\0\0\0"  # length, type, flags, stream


def expect_ray_head(address: str) -> None:
    """Connect to HOST:PORT, ray://HOST:PORT or, for `auto`, to RAY_ADDRESS; leaves other addresses to Ray.

    Raises:
        UserError: nothing answers there within 10 s, or something that is not Ray.
    """
    named = RAY_ADDRESS.value() if address == "auto" else address
    shown = address if named == address else f"{address} (RAY_ADDRESS {named})"
    try:
        parts = urlsplit(named if "://" in named else f"//{named}")
        is_client = parts.scheme == _CLIENT
        port = parts.port or (_CLIENT_PORT if is_client else None)
    except ValueError:  # no address: Ray says so
        return
    if parts.scheme not in ("", _CLIENT) or not parts.hostname or port is None:
        return
    try:
        _expect_answer(parts.hostname, port)
    except (OSError, UnicodeError) as error:  # UnicodeError: no name of a host
        reason = (error.strerror if isinstance(error, OSError) else "") or error
        option = "--ray-client-server-port" if is_client else "--port"
        raise UserError(
            f"--address {shown}: {reason}: expected a running Ray head, as of `ray start "
            f"--head {option} {port}` on {parts.hostname}"
        ) from None


def _expect_answer(host: str, port: int) -> None:
    """Raises:
    OSError: nothing answers, or something that is not gRPC.
    """
    with socket.create_connection((host, port), _ANSWER_S) as peer:
        if RAY_TLS.value().lower() in ("1", "true"):  # as Ray reads it
            return  # only those with a certificate learn more
        peer.sendall(_PREFACE + _NO_SETTINGS)
        head = b""
        while len(head) < len(_NO_SETTINGS) and (more := peer.recv(len(_NO_SETTINGS))):
            head += more
    if head[3:4] != _SETTINGS:
        raise OSError("what answers there is not Ray")
