"""What is said of a process that has ended."""

import signal

import pytest

from hsslam_services.launch.spawn import how_it_ended


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (1, "exited with code 1"),
        (-signal.SIGKILL, "was killed by SIGKILL"),
        (-40, "was killed by signal 40"),  # a real-time signal, which has no name
    ],
)
def test_every_way_to_end_has_words(code: int, text: str):
    assert how_it_ended(code) == text
