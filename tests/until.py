"""A wait for an event that another thread or process brings about; alone, as tests of many folders use it."""

import time
from collections.abc import Callable


def until(is_met: Callable[[], object], timeout_s: float = 10.0) -> None:
    """Wait until `is_met()`; fails after `timeout_s`."""
    deadline_s = time.monotonic() + timeout_s
    while not is_met():
        assert time.monotonic() < deadline_s, "timed out"
        time.sleep(0.005)
