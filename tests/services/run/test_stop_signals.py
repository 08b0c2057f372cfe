"""How many stop signals count; those with a + between them come at once."""

import subprocess
import sys

import pytest

_HEARS = """
import signal, sys
from hsslam_services.run.stop_signals import hear_stop_signals
counts = []
before = signal.SIG_IGN if sys.argv[1] == "nohup" else signal.SIG_DFL
signal.signal(signal.SIGHUP, before)  # whatever the tests run under
hear_stop_signals(counts.append)
together = {signal.Signals[name] for name in sys.argv[2].split("+")}
signal.pthread_sigmask(signal.SIG_BLOCK, together)
for number in together:
    signal.raise_signal(number)
signal.pthread_sigmask(signal.SIG_UNBLOCK, together)
for name in sys.argv[3:]:
    signal.raise_signal(signal.Signals[name])
print(counts[-1] if counts else 0)
"""


@pytest.mark.parametrize(
    ("way", "sent", "count"),
    [
        ("", ["SIGTERM+SIGHUP"], 1),  # systemd-logind
        ("", ["SIGHUP", "SIGHUP"], 1),  # bash, and the kernel once more
        ("", ["SIGINT", "SIGHUP"], 1),
        ("", ["SIGHUP", "SIGTERM", "SIGINT"], 2),
        ("nohup", ["SIGHUP", "SIGHUP"], 0),
    ],
)
def test_a_hangup_counts_only_if_nothing_else_comes(way: str, sent: list[str], count: int):
    command = [sys.executable, "-c", _HEARS, way, *sent]
    heard = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(heard.stdout) == count
