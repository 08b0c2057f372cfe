"""How many stop signals count; those with a + between them come at once, `later` is a pause."""

import os
import subprocess
import sys

import pytest

_HEARS = """
import signal, sys, time
from hsslam_services.run.stop_signals import ONE_REQUEST_S, hear_stop_signals
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
    if name == "later":
        time.sleep(1.2 * ONE_REQUEST_S)
    else:
        signal.raise_signal(signal.Signals[name])
print(*counts)
"""


@pytest.mark.parametrize(
    ("way", "sent", "told"),
    [
        ("", ["SIGTERM+SIGHUP"], "1"),  # systemd-logind
        ("", ["SIGHUP", "SIGHUP"], "1"),  # bash, and the kernel once more
        ("", ["SIGINT", "SIGHUP"], "1"),
        ("", ["SIGHUP", "SIGTERM", "later", "SIGINT"], "1 2"),
        ("", ["SIGTERM", "SIGTERM"], "1"),  # timeout: to its command, and to the group
        ("", ["SIGINT", "SIGINT", "later", "SIGINT", "SIGINT"], "1 2"),
        ("nohup", ["SIGHUP", "SIGHUP"], ""),
    ],
)
def test_signals_at_once_and_a_hangup_with_others_are_one_request(
    way: str, sent: list[str], told: str
):
    command = [sys.executable, "-c", _HEARS, way, *sent]
    heard = subprocess.run(command, capture_output=True, text=True, check=True)
    assert heard.stdout.strip() == told


_COMPILES = """
import signal
import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource
from hsslam_node.gpu_kernels.trial_kernel import _add_square
from hsslam_services.run.stop_signals import END_SIGNAL, leave_stop_signals_to_supervisor
heard = []
leave_stop_signals_to_supervisor()
signal.signal(END_SIGNAL, lambda *_: heard.append("end"))
types = {"a": "*fp32", "out": "*fp32", "SIZE": "constexpr"}
triton.compile(ASTSource(_add_square, types, {"SIZE": 16}, {}), target=GPUTarget("cuda", 90, 32))
for number in (END_SIGNAL, signal.SIGTERM):
    signal.raise_signal(number)
print(*heard)
"""


def test_a_process_that_compiled_kernels_for_a_gpu_still_ends_and_still_leaves_sigterm(tmp_path):
    """LLVM takes SIGUSR1 away: processes on a GPU did not end, and no run did."""
    pytest.importorskip("triton")
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    done = subprocess.run(
        [sys.executable, "-c", _COMPILES], env=environment | {"TRITON_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.split() == ["end"]
