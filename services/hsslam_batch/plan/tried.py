"""Tries a failed request to a store again; alone because stores, listings and fetches use it."""

import time
from collections.abc import Callable
from typing import TypeVar

_TRIES = 6
_FIRST_WAIT_S = 0.2  # doubled after each

_Answer = TypeVar("_Answer")


def tried(what: str, request: Callable[[], _Answer]) -> _Answer:
    """The answer to a request; tries again after an exception of any type.

    Raises:
        OSError: every try failed; the text begins with `what`. FileNotFoundError, FileExistsError and
            PermissionError are raised at the first try.
    """
    wait_s = _FIRST_WAIT_S
    for last in range(1, _TRIES + 1):
        try:
            return request()
        except (FileNotFoundError, FileExistsError, PermissionError):
            raise
        except Exception as error:
            if last == _TRIES:
                reason = next(iter(str(error).splitlines()), type(error).__name__)
                raise OSError(f"{what}: {reason}") from error
        time.sleep(wait_s)
        wait_s *= 2
    raise AssertionError
