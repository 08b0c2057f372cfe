"""The table of a document, written from results and from nothing else."""

import re
from pathlib import Path

from hsslam_node.errors import UserError

_END = "<!-- table:end -->"


def fill_table(document: Path, name: str, text: str) -> None:
    """Put the text between the lines `<!-- table:NAME -->` and `<!-- table:end -->`.

    Raises:
        UserError: the document or its lines are not there.
    """
    begin = f"<!-- table:{name} -->"
    try:
        old = document.read_text()
        pattern = re.compile(f"{re.escape(begin)}\n.*?{re.escape(_END)}", re.DOTALL)
        new, count = pattern.subn(lambda _: f"{begin}\n{text.strip()}\n{_END}", old)
        if count == 0:
            raise UserError(f"--docs {document}: expected the lines {begin} and {_END}")
        document.write_text(new)
    except OSError as error:
        raise UserError(f"--docs {document}: {error.strerror}: expected a document") from None
