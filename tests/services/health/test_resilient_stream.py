"""Output that nobody reads any more goes nowhere; what it told goes on."""

import os
from typing import TextIO, cast

from rich.console import Console

from hsslam_services.health.status_line import ResilientStream, StatusLine


def test_lines_come_through_until_the_reader_leaves_and_then_harm_nobody():
    read, write = os.pipe()
    with os.fdopen(write, "w", encoding="utf-8") as stream:
        with StatusLine(Console(file=cast(TextIO, ResilientStream(stream)))) as line:
            line.say("heard")
            assert os.read(read, 100) == b"heard\n"
            os.close(read)
            for _ in range(3):
                line.say("not heard")
        stream.write("nor is this")
