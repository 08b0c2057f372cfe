"""The address behind `--viewer connect:...`; alone, as options check it without importing rerun."""

from urllib.parse import urlsplit

from hsslam_node.errors import UserError

_CONNECT = "connect:"
_SCHEMES = ("rerun", "rerun+http", "rerun+https")


def is_address(viewer: str) -> bool:
    """Whether the viewer is one that another program started."""
    return viewer.startswith(_CONNECT)


def viewer_url(viewer: str) -> str:
    """The URL that rerun connects to, of `connect:HOST:PORT` or `connect:URL`.

    Raises:
        UserError: rerun could not connect to it.
    """
    address = viewer.removeprefix(_CONNECT)
    is_short = "://" not in address
    url = f"rerun+http://{address}/proxy" if is_short else address
    try:
        parts = urlsplit(url)
        has_port = parts.port != 0 and not (is_short and parts.port is None)
        is_usable = (
            parts.scheme in _SCHEMES and parts.hostname and has_port and parts.path == "/proxy"
        )
    except ValueError:  # of the port, or of a bracket
        is_usable = False
    if not is_usable or any(letter.isspace() for letter in url):
        raise UserError(
            f"--viewer {viewer}: expected connect:HOST:PORT or connect:rerun+http://HOST:PORT/proxy"
        )
    return url
