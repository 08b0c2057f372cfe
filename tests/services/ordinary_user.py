"""`python -m tests.services.ordinary_user COMMAND...`: with 8 MiB of locked memory, as many systems give.

Root has no limit, so it is not seen in tests that run as root.
"""

import ctypes
import os
import resource
import sys

import pytest

LIMIT_BYTES = 8 * 2**20
_PR_CAPBSET_DROP, _CAP_IPC_LOCK = 24, 14


def as_ordinary_user() -> tuple[str, ...]:
    """What to put before a command; skips the test where the limit cannot be set."""
    if 0 <= resource.getrlimit(resource.RLIMIT_MEMLOCK)[1] < LIMIT_BYTES:
        pytest.skip("this machine's hard limit of locked memory is lower")
    return (sys.executable, "-m", "tests.services.ordinary_user")


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (LIMIT_BYTES, LIMIT_BYTES))
    ctypes.CDLL(None).prctl(_PR_CAPBSET_DROP, _CAP_IPC_LOCK)  # takes effect with exec
    os.execvp(sys.argv[1], sys.argv[1:])
