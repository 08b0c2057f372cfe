"""Tries a failed request to a store again; alone because stores, listings and fetches use it."""

import itertools
import time
from collections.abc import Callable
from typing import TypeVar

_TRIES = 6
_FIRST_WAIT_S = 0.2  # doubled after each
_LONGEST_WAIT_S = 15.0

_Answer = TypeVar("_Answer")


def tried(what: str, request: Callable[[], _Answer], patience_s: float = 0.0) -> _Answer:
    """The answer to a request; tries again after an exception of any type.

    It tries six times, and then further until `patience_s` have passed since the first try.

    Raises:
        OSError: every try failed; the text begins with `what`. FileNotFoundError, FileExistsError and
            PermissionError are raised at the first try.
    """
    wait_s, last_s = _FIRST_WAIT_S, time.monotonic() + patience_s
    for count in itertools.count(1):
        try:
            return request()
        except (FileNotFoundError, FileExistsError, PermissionError):
            raise
        except Exception as error:
            if count >= _TRIES and time.monotonic() + wait_s > last_s:
                reason = next(iter(str(error).splitlines()), type(error).__name__)
                raise OSError(f"{what}: {reason}") from error
        time.sleep(wait_s)
        wait_s = min(2 * wait_s, _LONGEST_WAIT_S)
    raise AssertionError
