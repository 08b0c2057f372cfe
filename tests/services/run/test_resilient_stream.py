"""A reader of standard error that leaves, or stands still, holds nothing up."""

import os
import re
import threading
import time
from pathlib import Path
from typing import TextIO, cast

import pytest
from rich.console import Console

from hsslam_services.health.status_line import StatusLine
from hsslam_services.run.resilient_stream import ResilientStream, say_at_end


def test_lines_come_through_until_the_reader_leaves_and_then_harm_nothing():
    read, write = os.pipe()
    with os.fdopen(write, "w", encoding="utf-8") as stream:
        resilient = ResilientStream(stream)
        with StatusLine(Console(file=cast(TextIO, resilient))) as line:
            line.say("heard")
            assert os.read(read, 100) == b"heard\n"
            os.close(read)
            for _ in range(3):
                line.say("not heard")
        resilient.drain(10)
        stream.write("nor is this")


def test_a_reader_that_stands_still_costs_lines_and_no_time():
    read, write = os.pipe()
    with os.fdopen(write, "w", encoding="utf-8") as stream:
        resilient = ResilientStream(stream)
        start_s = time.monotonic()
        for number in range(2000):
            resilient.write(f"{number} {'x' * 1000}\n")
        assert time.monotonic() - start_s < 1.0
        resilient.drain(0.05)  # in vain
        heard = ""
        while "left out" not in heard or _written(heard) + _left_out(heard) < 2000:
            heard += os.read(read, 2**16).decode()
        resilient.write("again\n")
        while not heard.endswith("again\n"):
            heard += os.read(read, 2**16).decode()
    assert heard.startswith("0 x")
    assert _written(heard) < 1000 and _left_out(heard) == 2000 - _written(heard)
    os.close(read)


def _written(heard: str) -> int:
    """Number of whole lines of the writer."""
    return len(re.findall(r"^\d+ x+\n", heard, re.MULTILINE))


def _left_out(heard: str) -> int:
    """Number of lines that the stream reports as left out."""
    return sum(map(int, re.findall(r"^\((\d+) lines left out", heard, re.MULTILINE)))


def test_a_full_disk_costs_the_lines_that_it_does_not_take(tmp_path: Path):
    file = tmp_path / "stderr"
    with Path("/dev/full").open("w", encoding="utf-8") as stream, file.open("w") as disk:
        resilient = ResilientStream(stream)
        resilient.write("lost\n")
        resilient.write("lost, too\n")
        resilient.drain(10)
        os.dup2(disk.fileno(), stream.fileno())  # there is room again
        resilient.write("heard\n")
        resilient.drain(10)
    told = "(2 lines left out: stderr was not read, or the disk was full)"
    assert file.read_text() == f"heard\n{told}\n"


def test_last_words_are_said_though_a_thread_fails_to_start_once(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    start, failures = threading.Thread.start, [RuntimeError("can't start new thread")]

    def start_later(thread: threading.Thread) -> None:
        if failures:
            raise failures.pop()
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", start_later)
    say_at_end("heard")
    assert capfd.readouterr().err == "heard\n"
