"""MkDocs hook: a page that loads a script, style or image from elsewhere fails `mkdocs build --strict`."""

import logging
import re
from typing import Any

_LOG = logging.getLogger("mkdocs.hooks.remote_assets")
_REMOTE = re.compile(
    r'<(?:script|link|img|iframe|video)\b[^>]*\b(?:src|href)="((?:https?:)?//[^"]+)"'
)


def on_post_page(output: str, *, page: Any, **_: Any) -> None:
    """Warn of each remote address that a browser would fetch to show the page."""
    for address in _REMOTE.findall(output):
        _LOG.warning(
            "%s: loads %s, which a reader without a network lacks", page.file.src_uri, address
        )
