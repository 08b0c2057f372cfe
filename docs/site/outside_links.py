"""MkDocs hook: links to files of the repository that are not on the site become plain text.

In the repository these links work. A link to a file that does not exist fails `mkdocs build --strict`.
"""

import logging
import re
from pathlib import Path
from typing import Any

_LOG = logging.getLogger("mkdocs.hooks.outside_links")
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(((?:\.\./|figures)[^)#\s]*)\)")


def on_page_markdown(markdown: str, *, page: Any, config: Any, **_: Any) -> str:
    """The page without links to files outside `docs/` or to the folder of figures."""
    docs = Path(config.docs_dir).resolve()
    folder = Path(page.file.abs_src_path).resolve().parent

    def link_or_text(link: re.Match[str]) -> str:
        target = (folder / link[2]).resolve()
        if docs in target.parents and target.is_file():
            return link[0]
        if not target.exists():
            _LOG.warning("%s: link to %s, which does not exist", page.file.src_uri, link[2])
        return link[1]

    return _LINK.sub(link_or_text, markdown)
