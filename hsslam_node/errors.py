"""The exception whose text is meant for the user; a file of its own as every folder imports it."""

import difflib
from collections.abc import Iterable


class UserError(Exception):
    """Bad input, told in one line: what (file, topic, field or option), its value, what was expected.

    Command-line entry points print the message without a traceback and exit with code 2.
    """


class OutOfMemoryError(UserError):
    """The memory that a run needs is not there; unlike other bad input it cannot be skipped."""


def one_line(error: Exception) -> str:
    """Kind and text of an error of other packages, for a line that users read."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def did_you_mean(name: str, known: Iterable[str], cutoff: float = 0.5) -> str:
    """`; did you mean NAME?` with the nearest of the known names; empty if none is near."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return f"; did you mean {near[0]}?" if near else ""
