"""Running ahead, by a bounded number, with errors handed over."""

import sys
import threading
import time

import pytest

from hsslam_services.camera import prefetch
from hsslam_services.camera.prefetch import Prefetch
from tests.until import until


def test_order_is_kept_and_the_lead_is_bounded():
    made: list[int] = []

    def items():
        for k in range(20):
            made.append(k)
            yield k

    ahead = Prefetch(items(), depth=3)
    got = []
    for item in ahead:
        got.append(item)
        if len(got) < 17:  # those behind it are made: three wait, one is held
            until(lambda: len(made) >= len(got) + 4, 20)
        assert len(made) <= len(got) + 4
    assert got == list(range(20))
    ahead.close()


def test_error_of_the_items_is_raised_behind_what_came_before():
    def items():
        yield 1
        raise ValueError("broken")

    ahead = iter(Prefetch(items(), depth=2))
    assert next(ahead) == 1
    with pytest.raises(ValueError, match="broken"):
        next(ahead)


def test_an_exit_of_the_items_is_an_error_and_no_wait_without_end():
    def items():
        yield 1
        sys.exit(3)

    ahead = iter(Prefetch(items(), depth=2))
    assert next(ahead) == 1
    with pytest.raises(RuntimeError, match=r"SystemExit\(3\)"):
        next(ahead)


def test_close_does_not_wait_for_an_item_that_takes_minutes(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(prefetch, "_CLOSE_S", 0.1)
    minutes = threading.Event()

    def slow():
        minutes.wait(600)
        yield 0

    ahead = Prefetch(slow(), depth=2)
    start_s = time.monotonic()
    ahead.close()
    assert time.monotonic() - start_s < 60
    minutes.set()


def test_close_ends_the_thread_of_an_endless_source():
    def endless():
        while True:
            yield 0

    ahead = Prefetch(endless(), depth=2)
    next(iter(ahead))
    ahead.close()
    assert not ahead._thread.is_alive()
